"""OpenEXR files: linear light in float."""
