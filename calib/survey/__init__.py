"""Where a scene is in coordinates that others know: by surveyed points, by GPS, by another session."""
