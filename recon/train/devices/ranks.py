"""Training by several processes that `torchrun` started: one model, its views shared out.

Every rank (torch.distributed's word for a process) holds all Gaussians and the whole session, renders
its share of the views of an iteration, and adds its gradients to those of the others. From equal sums
all take equal steps, so their Gaussians stay equal, density control included; only rank 0 writes.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import TypeVar, cast

import torch
import torch.distributed as distributed
from torch import Tensor

from imaging.compute import threads
from imaging.errors import ReconstructionError, RigError

Decided = TypeVar("Decided")

LONGEST_WAIT = timedelta(hours=12)
"""Time after which a rank takes the others for lost: all but the first wait while that one decides."""


@dataclass(frozen=True)
class Ranks:
    """Rank among the processes; without others, everything here does nothing.

    Each method is a collective: all ranks call it, in the same order, with tensors of the same shapes.
    """

    number: int = 0
    count: int = 1

    @property
    def first(self) -> bool:
        """True for the one that writes files and prints."""
        return self.number == 0

    def add(self, tensors: Sequence[Tensor]) -> None:
        """Replace each tensor, wherever it is, by its sum over the ranks: the same bits on every rank."""
        if self.count == 1 or not tensors:
            return
        flat = torch.cat([tensor.reshape(-1).to(_device(), non_blocking=True) for tensor in tensors])
        distributed.all_reduce(flat)
        parts = torch.split(flat, [tensor.numel() for tensor in tensors])
        for tensor, part in zip(tensors, parts, strict=True):
            tensor.copy_(part.view_as(tensor))

    def raise_to_largest(self, tensor: Tensor) -> None:
        """Replace each number, wherever the tensor is, by the largest of all ranks, in place."""
        if self.count == 1:
            return
        moved = tensor.to(_device())
        distributed.all_reduce(moved, distributed.ReduceOp.MAX)
        tensor.copy_(moved)

    def totals(self, *numbers: float) -> list[float]:
        """Sums over the ranks."""
        if self.count == 1:
            return list(numbers)
        together = torch.tensor(numbers, dtype=torch.float64, device=_device())
        distributed.all_reduce(together)
        return [float(number) for number in together.tolist()]

    def decided(self, decide: Callable[[], Decided]) -> Decided:
        """Return what rank 0 decides, on every rank; a RigError or an interrupt of it is raised on all."""
        if self.count == 1:
            return decide()
        outcome: list[Decided | BaseException | None] = [None]
        if self.first:
            try:
                outcome[0] = decide()
            except (RigError, KeyboardInterrupt) as error:
                outcome[0] = error
        distributed.broadcast_object_list(outcome)
        self.totals(0.0)  # no rank goes on before the others know
        (result,) = outcome
        if isinstance(result, BaseException):
            raise result
        return cast(Decided, result)


def _device() -> str:
    """Return where collectives want their tensors."""
    return "cuda" if distributed.get_backend() == "nccl" else "cpu"


@contextmanager
def joined() -> Iterator[Ranks]:
    """The ranks that `torchrun` started together (NCCL on GPUs, else Gloo); alone without it.

    Ranks of one machine share its cores. ReconstructionError if they cannot find each other, or if not each
    has a GPU of its own where there are any.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count <= 1:
        yield Ranks()
        return
    here, gpus = int(os.environ.get("LOCAL_WORLD_SIZE", "1")), torch.cuda.device_count()
    # All ranks of the machine refuse: one that went on would wait for the others.
    if torch.cuda.is_available() and here > gpus:
        raise ReconstructionError(
            f"{here} processes need as many GPUs, and this machine has {gpus}: "
            f"start torchrun with --nproc-per-node {gpus} here."
        )
    before = threads.thread_count()
    threads.set_threads(before // here)
    if torch.cuda.is_available():
        torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
    try:
        distributed.init_process_group("nccl" if torch.cuda.is_available() else "gloo", timeout=LONGEST_WAIT)
    except (ValueError, RuntimeError) as error:
        raise ReconstructionError(
            f"The {count} processes of this training did not find each other: start them with torchrun."
        ) from error
    try:
        yield Ranks(distributed.get_rank(), distributed.get_world_size())
    finally:
        distributed.destroy_process_group()
        threads.set_threads(before)
