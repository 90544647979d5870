"""Drawings as inline SVG, and pictures as data URIs."""
