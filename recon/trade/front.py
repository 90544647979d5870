"""The Pareto front: what nothing else beats in both cost and quality."""

from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")


def front(points: Sequence[T], cost: Callable[[T], float], gain: Callable[[T], float]) -> list[T]:
    """The points for which no other costs no more and gains as much or more, by rising cost."""
    best: list[T] = []
    for point in sorted(points, key=lambda item: (cost(item), -gain(item))):
        if not best or gain(point) > gain(best[-1]):
            best.append(point)
    return best


def behind(points: Sequence[T], cost: Callable[[T], float], gain: Callable[[T], float], point: T) -> float:
    """Return how much less a point gains than the best of those that cost no more; 0 on the front."""
    return max(gain(other) for other in points if cost(other) <= cost(point)) - gain(point)
