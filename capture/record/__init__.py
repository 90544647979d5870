"""Shooting: cameras driven in threads through a plan, every shot on the disk before it counts."""
