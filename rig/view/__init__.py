"""`rig view`: a scene in the browser, drawn in float and turned into 8 bits only on the way out."""
