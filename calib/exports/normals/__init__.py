"""Normals and albedo of what a light dome lights, lamp after lamp."""
