"""What can be drawn of a finished scene: its light, and where its surfaces are and what they are known by."""
