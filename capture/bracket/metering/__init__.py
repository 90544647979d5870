"""The meter: the range of radiance that every camera sees, from a few noisy exposures."""
