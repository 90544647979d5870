"""Serving of pages: access, the first picture, and frames on their way to the browser."""
