"""What held-out quality a training will reach, foretold from two trainings in miniature.

Quality over the length of a whole schedule follows a power law, q(n) = q_end - a n^-b, as learning curves
do (Hestness et al., arXiv 1712.00409). b is common to scenes; a and q_end come from two short schedules of
this scene, the one of twice the length of the other.
"""

import math

from recon.model import Prediction
from recon.probe import Probe

EXPONENT = 0.55
SPREAD = 1.65
"""Half the interval, dB, for a training twice as long as the probe; it grows with the root of the doublings.
13 of 14 budgets of 20 to 120 s on seven simulated scenes ended within it, 11 with a half of 1.2
(bench/budget.py)."""


def predicted(found: Probe, iterations: int) -> Prediction | None:
    """The end of a training of `iterations`, with an interval; None where no view is held out."""
    if found.db is None or found.before is None:
        return None
    longer = max(iterations / found.iterations, 1.0)
    rise = max(found.db - found.before, 0.0)
    gain = rise * (1 - longer**-EXPONENT) / (2**EXPONENT - 1)
    half = SPREAD * math.sqrt(max(math.log2(longer), 0.25))
    db = found.db + gain
    return Prediction(db=round(db, 2), low=round(db - half, 2), high=round(db + half, 2))
