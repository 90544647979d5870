"""Threads of a capture, one for each camera, and where they wait for one another."""
