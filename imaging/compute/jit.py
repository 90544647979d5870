"""Numba compilation of this project's kernels: strict floats, and cached on disk.

* No fast-math flag that assumes away NaN or infinities, or reorders sums: results do not depend on the
  thread count. In kernels contraction to FMA is allowed (`contract`), zeros may lose their sign, division
  by a constant may become a product.
* The cache is `$NUMBA_CACHE_DIR`, else `$XDG_CACHE_HOME/hdr-rig/numba`, else `~/.cache/hdr-rig/numba`.
  Below it is a folder named by a hash of the sources: Numba itself notices only a change of the file that
  holds a function, not of a file whose functions it inlined.
* Compiled code is serial and runs without Python's lock; `imaging.compute.threads` runs it on all cores.
"""

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Kernel = Callable[..., Any]
FunctionT = TypeVar("FunctionT", bound=Callable[..., object])

_OPTIONS: dict[str, Any] = {"fastmath": {"contract", "nsz", "arcp"}, "error_model": "numpy"}
_ROOT = Path(__file__).parents[2]
_SOURCES = ("imaging", "drivers", "calib", "recon")


def caches() -> Path:
    """Return rig's folder of what can be made again: `$XDG_CACHE_HOME/hdr-rig`, else `~/.cache/hdr-rig`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "hdr-rig"


def cache_folder() -> Path:
    """Return where the compiled code of exactly these sources is kept."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    base = Path(given) if given else caches() / "numba"
    digest = hashlib.sha256(numba.__version__.encode())
    for folder in _SOURCES:
        for source in sorted((_ROOT / folder).rglob("*.py")):
            text = source.read_bytes()
            # Whatever is compiled, or inlined in what is.
            if b"numba" in text or b"compute.jit" in text:
                digest.update(text)
    return base / digest.hexdigest()[:16]


@cache
def _usable_folder() -> Path | None:
    """The folder of the cache; None where it cannot be written (numba makes it)."""
    folder = cache_folder()
    nearest = next(parent for parent in (folder, *folder.parents) if parent.exists())
    return folder if os.access(nearest, os.W_OK | os.X_OK) else None


def _compile(function: FunctionT, **options: Any) -> FunctionT:
    """Compile like numba.njit, with the cache in this project's folder."""
    folder, before = _usable_folder(), numba.config.CACHE_DIR
    try:
        if folder is not None:
            numba.config.CACHE_DIR = str(folder)
        return cast(FunctionT, numba.njit(cache=folder is not None, nogil=True, **options)(function))
    finally:
        # The setting is global; other packages of the program choose for themselves.
        numba.config.CACHE_DIR = before


def compiled(function: FunctionT) -> FunctionT:
    """Compile a function of numbers and arrays at its first call; every operation is rounded by itself."""
    return _compile(function)


def kernel(function: Kernel) -> Kernel:
    """Compile a function that Python calls, at its first call; it releases the GIL and checks no index."""
    return _compile(function, no_cfunc_wrapper=True, **_OPTIONS)


def inlined(function: Kernel) -> Kernel:
    """Compile a function that only kernels call: inlined in them and kept with them, not by itself."""
    made: Kernel = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
    return made
