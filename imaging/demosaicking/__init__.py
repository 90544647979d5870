"""Three colours of a mosaic, along edges, and how certain they are."""
