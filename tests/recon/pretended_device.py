"""A device that is not there, to count what crosses between it and the host.

Its tensors say that they are on torch's `meta` device and hold their values on the CPU, where every operation
on them is carried out. Triton's kernels run there too, by its interpreter.
"""

import inspect
import os
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode, _disable_current_modes
from torch.utils._pytree import tree_leaves, tree_map

import recon
import recon.splat as splat
from recon.observe import glare
from recon.observe.losses import dense_ssim
from recon.scene import environment

if not torch.cuda.is_available():
    os.environ["TRITON_INTERPRET"] = "1"  # read when Triton is first imported

DEVICE = torch.device("meta")
Counts = Counter[tuple[str, str]]
"""Counts by ("wait" or "copy", the function of recon that caused it)."""

_CPU = torch.device("cpu")
_ROOT = str(Path(recon.__file__).parent)
_SIZED_BY_VALUES = {"nonzero", "masked_select", "_unique2", "unique_consecutive", "bincount"}
_READ = {"_local_scalar_dense", "equal"}


class OnDevice(torch.Tensor):
    """A tensor of the device; `held` has its values."""

    held: torch.Tensor
    __torch_function__ = torch._C._disabled_torch_function_impl

    @staticmethod
    def __new__(cls, held: torch.Tensor) -> "OnDevice":
        options = {"strides": held.stride(), "storage_offset": held.storage_offset(), "dtype": held.dtype}
        made = torch.Tensor._make_wrapper_subclass(cls, held.shape, device=DEVICE, **options)
        made.held = held
        return made

    @classmethod
    def __torch_dispatch__(cls, function: Any, types: Any, arguments: Any = (), options: Any = None) -> Any:
        raise AssertionError(f"{function} on a tensor of a device that is gone")


def _held(value: Any) -> Any:
    return value.held if isinstance(value, OnDevice) else value


def _asking() -> str:
    """The innermost function of `recon` on the stack."""
    frame = inspect.currentframe()
    while frame is not None:
        if frame.f_code.co_filename.startswith(_ROOT):
            return f"{Path(frame.f_code.co_filename).stem}.{frame.f_code.co_qualname}"
        frame = frame.f_back
    return "elsewhere"


class _Operations(TorchDispatchMode):
    """Carries out operations, and counts what crosses."""

    def __init__(self, counts: Counts) -> None:
        super().__init__()
        self.counts = counts

    def __torch_dispatch__(self, function: Any, types: Any, arguments: Any = (), options: Any = None) -> Any:
        options = options or {}
        tensors = [leaf for leaf in tree_leaves((arguments, options)) if isinstance(leaf, torch.Tensor)]
        there = [tensor for tensor in tensors if isinstance(tensor, OnDevice)]
        target = options.get("device")
        goes_there = bool(there) if target is None else target.type == DEVICE.type
        kind = self._crossing(function, arguments, options, tensors, goes_there)
        if kind:
            self.counts[kind, _asking()] += 1
        moved = {name: _CPU if name == "device" else value for name, value in options.items()}
        result = function(*tree_map(_held, arguments), **tree_map(_held, moved))
        known = {id(tensor.held): tensor for tensor in there}

        def placed(value: Any) -> Any:
            if not isinstance(value, torch.Tensor):
                return value
            if id(value) in known:  # what was written to is given back
                return known[id(value)]
            return OnDevice(value) if goes_there else value

        return tree_map(placed, result)

    def _crossing(
        self, function: Any, arguments: Any, options: Any, tensors: list[Any], goes_there: bool
    ) -> str:
        """Kind of an operation beside its own work: "wait", "copy" (asynchronous) or nothing."""
        name, there = function._schema.name.removeprefix("aten::"), [isinstance(t, OnDevice) for t in tensors]
        if name in ("_to_copy", "copy_"):
            if name == "_to_copy":
                to, free = goes_there, bool(options.get("non_blocking"))
            else:
                to, free = there[0], bool(arguments[2]) if len(arguments) > 2 else False
            if there[-1] == to:
                return ""
            return "copy" if free and to else "wait"
        if not any(there):
            assert not goes_there or not tensors or name == "lift_fresh", f"{function} moves to the device"
            return ""
        hosted = [t for t, on in zip(tensors, there, strict=True) if not on and t.ndim]
        if name in ("index", "index_put", "index_put_", "_index_put_impl_"):
            masks = [t for t in tree_leaves(arguments[1]) if t is not None and t.dtype == torch.bool]
            return "wait" if masks or hosted else ""
        assert not hosted, f"{function} of tensors on two devices"
        sized = name == "repeat_interleave" and options.get("output_size") is None
        return "wait" if sized or name in _SIZED_BY_VALUES | _READ else ""


class _Constructors(TorchFunctionMode):
    """Tensors that are made of numbers come from the host."""

    def __torch_function__(self, function: Any, types: Any, arguments: Any = (), options: Any = None) -> Any:
        options = dict(options or {})
        if function in (torch.tensor, torch.as_tensor) and options.get("device") == DEVICE:
            return function(*arguments, **options | {"device": _CPU}).to(DEVICE)
        if function is torch.Tensor.new_tensor and arguments[0].device == DEVICE:
            made = torch.tensor(*arguments[1:], **{"dtype": arguments[0].dtype} | options)
            return made.to(DEVICE)
        if function is torch.Tensor.tolist:
            return arguments[0].cpu().tolist()
        return function(*arguments, **options)


@contextmanager
def pretended() -> Iterator[Counts]:
    """Within the block `DEVICE` is one on which `rasterize` renders by the GPU's kernels."""
    from triton.runtime.interpreter import GridExecutor

    from recon.splat.gpu import rasterize_gpu

    counts: Counts = Counter()
    launch = GridExecutor.__call__

    def launched(self: Any, *arguments: Any, **options: Any) -> Any:
        with _disable_current_modes():
            return launch(self, *map(_held, arguments), **options)

    cached = (dense_ssim._taps, environment._rays, glare._halo)
    for function in cached:  # other tests' tensors of the meta device have no values
        function.cache_clear()
    try:
        with pytest.MonkeyPatch.context() as patch, _Constructors(), _Operations(counts):
            patch.setattr(GridExecutor, "__call__", launched)
            patch.setattr(splat, "_check", lambda *_: None)
            patch.setattr(splat, "_rasterizer", lambda *_: rasterize_gpu)
            yield counts
    finally:
        for function in cached:
            function.cache_clear()
