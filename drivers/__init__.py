"""How a camera is spoken to: the `Camera` protocol, and simulated cameras that follow it."""
