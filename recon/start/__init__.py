"""Start of a training: points on surfaces, Gaussians at them, and the light from far away."""
