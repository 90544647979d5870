"""Vector quantisation of the harmonics of Gaussians: a palette, which a file indexes."""

import numpy as np
import torch

from imaging.arrays import Array, Integers
from imaging.progress import Progress, unreported

MOST = 65_536
"""Largest palette with 16-bit indices."""
_SIZE = 2048
"""Vectors of a palette that is shared: more take minutes without a GPU."""
_SAMPLE = 32_768
"""Vectors from which the palette is computed."""
_ROUNDS = 4
_CHUNK = 8192


def palette(vectors: Array, progress: Progress = unreported) -> tuple[Array, Integers]:
    """Return the palette [P, D], and the index of each of the vectors [N, D]: int64 [N].

    Up to 65,536 are their own palette; of more, k-means makes one of 2,048. The same vectors give the same.
    """
    if len(vectors) <= MOST:
        return vectors, np.arange(len(vectors))
    generator = np.random.Generator(np.random.PCG64(0))
    sample = torch.from_numpy(vectors[generator.choice(len(vectors), _SAMPLE, replace=False)]).float()
    entries = sample[:_SIZE].clone()
    for _ in range(_ROUNDS):
        labels = _labels(sample, entries)
        sums = torch.zeros_like(entries).index_add_(0, labels, sample)
        counts = torch.bincount(labels, minlength=_SIZE)[:, None]
        entries = torch.where(counts > 0, sums / counts.clamp_min(1), entries)
    chunk_labels = []
    for first in range(0, len(vectors), _CHUNK):
        progress("choosing harmonics", first, len(vectors))
        chunk_labels.append(_labels(torch.from_numpy(vectors[first : first + _CHUNK]).float(), entries))
    return entries.double().numpy(), torch.cat(chunk_labels).numpy()


def _labels(vectors: torch.Tensor, entries: torch.Tensor) -> torch.Tensor:
    """The nearest entry of each vector."""
    half = entries.square().sum(1) / 2
    chunks = (vectors[first : first + _CHUNK] for first in range(0, len(vectors), _CHUNK))
    return torch.cat([(half - chunk @ entries.T).argmin(1) for chunk in chunks])
