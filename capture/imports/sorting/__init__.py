"""Photographs sorted into cameras, frames and brackets."""
