"""Regions of a scene: the parts that have to agree before light is corrected for all of it.

Points that lie side by side belong to one surface, and its sheen, its slope and its shadow change with the
direction alike in all of them: thousands of such points are one witness, not thousands. What a camera or a
lens does to a photograph it does to all regions.
"""

import numpy as np

from imaging.arrays import Array, Integers

REGIONS = 20
FEWEST = 12
"""Points of a region, below which there are fewer regions."""
SPAN = (0.1, 0.9)
"""Quantiles between which a region is measured, so that stray points do not make it long."""


def regions_of(places: Array) -> Integers:
    """Number of the region of each point, int64 [N]: boxes of about as many points each.

    places: of the points, float64 [N, 3], in any unit. The largest box is halved along its longest side until
    there are enough.
    """
    boxes = [np.arange(len(places))]
    while len(boxes) < min(REGIONS, len(places) // FEWEST):
        boxes.sort(key=len)
        largest = boxes.pop()
        low, high = np.quantile(places[largest], SPAN, axis=0)
        order = largest[np.argsort(places[largest, int((high - low).argmax())], kind="stable")]
        boxes += [order[: len(order) // 2], order[len(order) // 2 :]]
    region = np.zeros(len(places), np.int64)
    for number, box in enumerate(boxes):
        region[box] = number
    return region
