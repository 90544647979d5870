"""A scene for other programs: each format, what it cannot hold of the light, measured on the scene."""
