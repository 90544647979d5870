"""Cache of the views' constant targets, made once, and kept where they are compared."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor

from imaging.arrays import AnyArray, Array32
from recon.data.dataset import View

SHARE = 0.5
"""Share of a GPU's memory in use above which no more is kept there; the rest is for Gaussians and renders."""

TargetsOfView = TypeVar("TargetsOfView")
"""A dataclass; its tensors are what is kept."""


@dataclass
class Targets(Generic[TargetsOfView]):
    """Targets of each view: on the device of the render while it has room, else on the host.

    From there they are sent at each look, through page-locked memory, asynchronously.
    Targets of a view whose shots exceed the memory are made at each access.
    """

    _cached: dict[str, tuple[int, TargetsOfView]] = field(default_factory=dict)
    _arrays: dict[int, tuple[AnyArray, Tensor]] = field(default_factory=dict)

    def of(self, view: View, make: Callable[[], TargetsOfView], device: torch.device) -> TargetsOfView:
        """Return a view's targets on a device; `make` gives them on the host at the first access.

        At another size of the view they are made anew, in place of those.
        """
        width, targets = self._cached.get(view.name, (0, None))
        if targets is None or width != view.lens.width:
            targets = make()
            if fits := device.type != "cpu" and sum(
                tensor.nbytes for tensor in _tensors(targets).values()
            ) <= room(device):
                targets = _moved(targets, device)
            if fits or view.held:
                self._cached[view.name] = view.lens.width, targets
        return _moved(targets, device)

    def array(self, values: Array32, image: Tensor) -> Tensor:
        """An array that several views may have in common, on the device and of the dtype of an image."""
        if image.device.type == "cpu":
            return torch.from_numpy(values).to(image.dtype)
        entry = self._arrays.get(id(values))
        if entry is None:
            tensor = torch.from_numpy(values)
            if tensor.nbytes <= room(image.device):
                tensor = sent(tensor, image.device)
            entry = self._arrays[id(values)] = values, tensor  # the array lives on, so no other has its id
        return sent(entry[1], image.device).to(image.dtype)


def room(device: torch.device) -> float:
    """Bytes that may yet be kept on a device."""
    if device.type != "cuda":
        return sys.maxsize
    total = torch.cuda.get_device_properties(device).total_memory
    return SHARE * total - torch.cuda.memory_allocated(device)


def sent(tensor: Tensor, device: torch.device) -> Tensor:
    """A tensor on a device, itself if it is there; the host goes on before it has come."""
    if tensor.device == device:
        return tensor
    if device.type == "cuda":
        tensor = tensor.pin_memory()
    return tensor.to(device, non_blocking=True)


def _tensors(targets: Any) -> dict[str, Tensor]:
    values = {each.name: getattr(targets, each.name) for each in fields(targets)}
    return {name: value for name, value in values.items() if isinstance(value, Tensor)}


def _moved(targets: TargetsOfView, device: torch.device) -> TargetsOfView:
    tensors = _tensors(targets)
    if all(tensor.device == device for tensor in tensors.values()):
        return targets
    return replace(targets, **{name: sent(tensor, device) for name, tensor in tensors.items()})  # type: ignore[type-var]
