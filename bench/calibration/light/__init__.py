"""Light of cameras, measured against the truth and against peers: sensors, response, colour, scale."""
