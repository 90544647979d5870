"""Numbers as bytes that name one of 256 values, chosen for the numbers at hand."""

import numpy as np

from imaging.arrays import Array, Bytes

SIZE = 256
_ROUNDS = 30
_SAMPLES = 200_000
"""Number of samples, evenly by rank, from which the values are chosen when there are more."""


def codebook(values: Array) -> Array:
    """256 ascending values near which numbers of any shape are: k-means on a line (Lloyd 1982).

    It starts from half quantiles and half even steps, so that both the many and the far are near to one.
    """
    ordered = np.sort(values, axis=None)
    if len(ordered) > _SAMPLES:
        ordered = ordered[np.linspace(0, len(ordered) - 1, _SAMPLES).round().astype(np.int64)]
    half = np.linspace(0, 1, SIZE // 2)
    book = np.sort(np.concatenate([np.quantile(ordered, half), ordered[0] + half * np.ptp(ordered)]))
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    for _ in range(_ROUNDS):
        ends = np.searchsorted(ordered, (book[1:] + book[:-1]) / 2)
        first, last = np.concatenate([[0], ends]), np.concatenate([ends, [len(ordered)]])
        count = last - first
        means = (sums[last] - sums[first]) / np.maximum(count, 1)
        book = np.sort(np.where(count > 0, means, book))
    return book


def nearest(values: Array, book: Array) -> Bytes:
    """The place in an ascending book of what is nearest to each number, uint8 of the same shape."""
    return np.searchsorted((book[1:] + book[:-1]) / 2, values).astype(np.uint8)
