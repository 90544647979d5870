"""Pictures of rig's own pages, for the documentation."""
