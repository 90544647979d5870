"""Sessions on disk: captured from cameras or imported from photographs, and verified."""
