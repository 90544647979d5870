"""Data of a training: views, pixels, and the light of brackets."""
