"""How much larger the learning rates of a short training are, and how much smaller those of a long one.

The rates of the methods are tuned for trainings of `USUAL` iterations. In a shorter one parameters would
stop on the way, in a longer one they would wander about where they should be.
"""

USUAL = 2000
POWER = 0.4
"""From 25 to 1000 iterations the rates of this law lie within a few tenths of a dB of the best that were
tried, and 0.1 to 4 dB above the usual ones (bench/haste.py)."""


def haste(iterations: int) -> float:
    """Factor of the learning rates of a whole schedule of `iterations`."""
    return float((USUAL / iterations) ** POWER)
