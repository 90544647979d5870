"""How this project's Numba kernels are compiled: strict floats, cached on disk, all cores or fewer.

Import `kernel` and `parallel_kernel` from here, before anything else imports numba in the module.

* No fast-math flag that assumes away NaN or infinities, or reorders sums: results do not depend on the
  thread count. Contraction to FMA is allowed (`contract`), zeros may lose their sign, division by a
  constant may become a product.
* The cache is `$NUMBA_CACHE_DIR`, else `$XDG_CACHE_HOME/hdr-rig/numba`, else `~/.cache/hdr-rig/numba`.
  Below it is a folder named by a hash of the kernels' sources: Numba itself notices only a change of the
  file that holds a kernel, not of a file whose functions it inlined.
* Parallel kernels must not run in two Python threads at once (Numba's fallback threading layer aborts
  the process then): callers hold `RUNNING`.
"""

import hashlib
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba

_FLAGS = {"contract", "nsz", "arcp"}
RUNNING = threading.RLock()
"""Held while a parallel kernel runs."""


def cache_folder() -> Path:
    """Where the compiled kernels of exactly these sources are kept."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        base = Path(given)
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hdr-rig" / "numba"
    digest = hashlib.sha256()
    here = Path(__file__).parent
    for source in [here / "jit.py", *sorted(here.glob("ssim*.py")), *sorted(here.glob("splat/*.py"))]:
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

Kernel = Callable[..., Any]


def kernel(function: Kernel) -> Kernel:
    """Compile a serial function, called from Python or from other kernels."""
    compiled: Kernel = numba.njit(cache=_CACHE, fastmath=_FLAGS, nogil=True, error_model="numpy")(function)
    return compiled


def parallel_kernel(function: Kernel) -> Kernel:
    """Compile a function whose `numba.prange` loops run on all threads."""
    compiled: Kernel = numba.njit(
        cache=_CACHE, fastmath=_FLAGS, nogil=True, error_model="numpy", parallel=True
    )(function)
    return compiled


def thread_count() -> int:
    """Threads that parallel kernels use (at first: the cores this process may run on)."""
    return int(numba.get_num_threads())


def set_threads(count: int) -> None:
    """Use `count` threads, at most the cores there were at start; results do not depend on it."""
    numba.set_num_threads(max(1, min(count, numba.config.NUMBA_NUM_THREADS)))


@contextmanager
def running(work: float) -> Iterator[None]:
    """Hold the lock while a kernel runs, on one thread if `work` (microseconds, roughly) is small.

    Waking a second thread costs more than a small job, the more so on a busy machine.
    """
    with RUNNING:
        threads = thread_count()
        if work < 100.0 and threads > 1:
            numba.set_num_threads(1)
            try:
                yield
            finally:
                numba.set_num_threads(threads)
        else:
            yield
