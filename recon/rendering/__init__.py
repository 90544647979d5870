"""Drawing of a finished scene: its light, its surfaces, and their confidence."""
