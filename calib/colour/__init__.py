"""What a colour chart and shared scene points tell of a rig's colours."""
