"""How this project's Numba kernels are compiled: strict floats, and cached on disk.

* No fast-math flag that assumes away NaN or infinities, or reorders sums: results do not depend on the
  thread count. Contraction to FMA is allowed (`contract`), zeros may lose their sign, division by a
  constant may become a product.
* The cache is `$NUMBA_CACHE_DIR`, else `$XDG_CACHE_HOME/hdr-rig/numba`, else `~/.cache/hdr-rig/numba`.
  Below it is a folder named by a hash of the kernels' sources: Numba itself notices only a change of the
  file that holds a kernel, not of a file whose functions it inlined.
* Kernels are serial; `recon.threads` runs one on several threads.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

Kernel = Callable[..., Any]

_OPTIONS: dict[str, Any] = {"fastmath": {"contract", "nsz", "arcp"}, "error_model": "numpy"}
_SOURCES = ("jit.py", "threads.py", "ssim.py", "lanes/*.py", "splat/*.py")


def cache_folder() -> Path:
    """Where the compiled kernels of exactly these sources are kept."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        base = Path(given)
    else:
        caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        base = Path(caches) / "hdr-rig" / "numba"
    digest = hashlib.sha256(numba.__version__.encode())
    here = Path(__file__).parent
    for pattern in _SOURCES:
        for source in sorted(here.glob(pattern)):
            digest.update(source.read_bytes())
    return base / digest.hexdigest()[:16]


def _usable(folder: Path) -> bool:
    """Whether the nearest existing parent of `folder` can be written to (numba makes the folder)."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    return os.access(folder, os.W_OK | os.X_OK)


_FOLDER = cache_folder()
_CACHE = _usable(_FOLDER)
if _CACHE:
    numba.config.CACHE_DIR = str(_FOLDER)


def kernel(function: Kernel) -> Kernel:
    """Compile a function that Python calls, at its first call; it releases the GIL and checks no index."""
    compiled: Kernel = numba.njit(cache=_CACHE, nogil=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
    return compiled


def inlined(function: Kernel) -> Kernel:
    """Compile a function that only kernels call: inlined in them and kept with them, not by itself."""
    compiled: Kernel = numba.njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)(function)
    return compiled
