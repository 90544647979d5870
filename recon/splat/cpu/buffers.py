"""Memory that is used again: a render's tables live from its forward to the end of its backward pass.

Fresh megabytes from the system cost more than filling them, and a training step would ask for tens of
them. Several renders may be alive at once (a batch of views), so each takes a set of its own.
"""

import math

import numpy as np
import numpy.typing as npt

from imaging.arrays import AnyArray, Bytes

_LINE = 64
_free: list["Buffers"] = []


class Buffers:
    """A set of named arrays, grown when needed and never shrunk."""

    def __init__(self) -> None:
        self._bytes: dict[str, Bytes] = {}

    def array(self, name: str, shape: int | tuple[int, ...], dtype: npt.DTypeLike) -> AnyArray:
        """An uninitialised array; it is valid until the next request of the same name."""
        kind = np.dtype(dtype)
        sizes = (shape,) if isinstance(shape, int) else shape
        need = math.prod(sizes) * kind.itemsize
        held = self._bytes.get(name)
        if held is None or len(held) < need:
            held = None
            self._bytes.pop(name, None)  # before its successor is there: both together would be the peak
            # A quarter more, so that a slowly growing scene does not ask every time; from a cache line on.
            whole = np.empty(need + need // 4 + _LINE, np.uint8)
            held = whole[-whole.ctypes.data % _LINE :]
            self._bytes[name] = held
        return held[:need].view(kind).reshape(sizes)


class Lease:
    """Holds a set of buffers; they go back to the pool when the last reference to the lease is gone."""

    def __init__(self) -> None:
        try:
            self.buffers = _free.pop()
        except IndexError:
            self.buffers = Buffers()

    def __del__(self, free: list[Buffers] = _free) -> None:  # an argument: it outlives the module at exit
        free.append(self.buffers)
