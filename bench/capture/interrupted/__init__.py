"""Captures that are killed, run out of disk, or lose a camera or their folder, and what is left of them."""
