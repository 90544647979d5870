"""One picture file as capture looks at it: read whole, reduced, or as a thumbnail."""
