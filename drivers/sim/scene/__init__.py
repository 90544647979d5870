"""Simulated scenes whose radiance is known in closed form for every ray."""
