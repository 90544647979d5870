"""What a training starts from: points on surfaces, Gaussians at them, and the light from far away."""
