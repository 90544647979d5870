"""Torch on one thread while kernels of our own use all of them."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch


@contextmanager
def torch_on_one_thread() -> Iterator[None]:
    """Run torch on the calling thread within the block; afterwards as before.

    A training step has some dozen torch operations of a few hundred microseconds on a few ten thousand
    Gaussians. Sharing each of them costs more than it saves, and on a machine with other work five
    times more (measured: 300 instead of 45 ms of processor time a step), since OpenMP's threads spin.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
