"""Photographs sorted into the cameras that took them."""
