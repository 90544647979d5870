"""Splat files of other programs as scenes, and scenes as splat files for viewers."""
