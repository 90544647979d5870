"""Views from one place as one map of all directions: a panorama of light, for lighting."""
