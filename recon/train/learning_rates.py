"""Learning rates for short and long trainings: larger and smaller ones.

The rates of the methods are tuned for trainings of `USUAL` iterations. In a shorter one parameters would
stop on the way, in a longer one they would wander about where they should be.
"""

USUAL = 2000
POWER = 0.4
"""Exponent of the rates by length. Over the usual rates the light of five scenes gains 4 to 6 dB at 25
iterations, 2 to 4 at 100, 0.6 to 1.3 at 300 and -0.2 to 0.2 at 1000; no other rates that were tried had much
more (bench/results/learning_rates.md).
"""


def rate_factor(iterations: int) -> float:
    """Factor of the learning rates of a whole schedule of `iterations`."""
    return float((USUAL / iterations) ** POWER)
