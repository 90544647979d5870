"""What a still camera's shutter does when it shows a round number: a power of two, in thirds of a stop."""

from collections.abc import Iterable

_SLOW = (30, 25, 20, 15, 13, 10, 8, 6, 5, 4, 3.2, 2.5, 2, 1.6, 1.3, 1, 0.8, 0.6, 0.5, 0.4, 0.3)
_FAST = (4, 5, 6, 8, 10, 13, 15, 20, 25, 30, 40, 50, 60, 80, 100, 125, 160, 200, 250, 320, 400, 500)
_FASTEST = (640, 800, 1000, 1250, 1600, 2000, 2500, 3200, 4000, 5000, 6400, 8000)
_NAMES = (*_SLOW, *(1 / value for value in _FAST + _FASTEST))


def exact_times(labels: Iterable[float]) -> dict[float, float] | None:
    """The power of two, s, behind each label, s; None unless all labels are names of the standard series.

    A camera that states other times, as a phone or an industrial camera does, means them as they are.
    """
    found = {}
    for label in labels:
        index = min(range(len(_NAMES)), key=lambda i: abs(_NAMES[i] / label - 1))
        if abs(_NAMES[index] / label - 1) > 2e-3:
            return None
        found[label] = 2.0 ** ((15 - index) / 3)
    return found
