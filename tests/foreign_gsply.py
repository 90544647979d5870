"""gsply as Python runs it: to compile its functions takes longer than scenes as small as those of tests."""

import numba

_compiled = numba.config.DISABLE_JIT
numba.config.DISABLE_JIT = True
try:
    import gsply
finally:
    numba.config.DISABLE_JIT = _compiled

__all__ = ["gsply"]
