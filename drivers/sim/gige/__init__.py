"""Simulated GigE Vision cameras, on UDP."""
