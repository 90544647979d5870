"""Time, memory and quality of a training: what it may take, and what it will."""
