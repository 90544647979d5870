"""What simulated cameras look at: scenes whose radiance is known in closed form for every ray."""
