"""Simulated cameras: an analytic scene, a lens, an EMVA 1288 sensor."""
