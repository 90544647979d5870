"""A simulated camera from the lens to the file, before any bus: optics, sensor, shutter, response."""
