"""Sensors: colour filters, RAW frames, the noise model, and what was measured at one ISO."""
