"""Views from one place, as of a camera on a nodal head: turns and lenses, and no depth."""
