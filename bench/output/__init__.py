"""Exports, other viewers, and storage of EXR, measured."""
