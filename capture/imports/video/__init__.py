"""Frames of a video, and the colours that its streams state."""
