"""Vectors of floats as Numba values: SIMD written out, not hoped for.

`Lanes` are an LLVM vector, sixteen float32 or eight float64: one AVX-512 register, two of AVX2, four of
SSE or NEON; LLVM splits it by itself, so the same kernel runs everywhere. LLVM's own vectoriser handles
kernels like ours only by accident (a changed mask made such a loop scalar and five times slower), and it
may not vectorise sums at all without leave to reorder them. All operations are strict IEEE ones; those on
float64 may be contracted to FMA.

In kernels: `+ - * /` with Lanes (or Lanes and a scalar of their kind), `fma(a, b, c)` = a b + c, `minus`,
`root`, `floor`, `ceiling`, `absolute`, `minimum`, `maximum`; masks from `at_least(a, b)`, `above(a, b)` and
`both(m, n)`, used by `choose(mask, x, y)`; memory: `splat`, `load`, `store`, `load_first`, `store_first`,
`keep_first`; over the lanes: `total`, `largest`, `totals`; patterns: `lane_number`, `lane_column`,
`lane_row`; exponents: `round_bits`, `rounded`, `scale_by`, `split_exponent`; on tuples of lanes, one a
channel: `load_each`, `store_each`, `fma_each`, `dot_each`, `times_each`, `plus_each`.
"""

from recon.splat.cpu.lanes.across import lane_column, lane_number, lane_row, largest, total, totals
from recon.splat.cpu.lanes.arithmetic import (
    above,
    absolute,
    at_least,
    both,
    ceiling,
    choose,
    floor,
    fma,
    maximum,
    minimum,
    minus,
    root,
)
from recon.splat.cpu.lanes.each import (
    dot_each,
    fma_each,
    load_each,
    plus_each,
    store_each,
    times_each,
)
from recon.splat.cpu.lanes.exponent import round_bits, rounded, scale_by, split_exponent
from recon.splat.cpu.lanes.kinds import WIDTH, WIDTH_64
from recon.splat.cpu.lanes.memory import keep_first, load, load_first, splat, store, store_first

__all__ = [
    "WIDTH",
    "WIDTH_64",
    "above",
    "absolute",
    "at_least",
    "both",
    "ceiling",
    "choose",
    "dot_each",
    "floor",
    "fma",
    "fma_each",
    "keep_first",
    "lane_column",
    "lane_number",
    "lane_row",
    "largest",
    "load",
    "load_each",
    "load_first",
    "maximum",
    "minimum",
    "minus",
    "plus_each",
    "root",
    "round_bits",
    "rounded",
    "scale_by",
    "splat",
    "split_exponent",
    "store",
    "store_each",
    "store_first",
    "times_each",
    "total",
    "totals",
]
