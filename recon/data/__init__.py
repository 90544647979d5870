"""Data of a training: views, pixels, the light of brackets, and the truth if known."""
