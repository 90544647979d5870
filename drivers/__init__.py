"""Camera drivers: the `Camera` protocol, and simulated cameras that follow it."""
