# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Sums and maxima over the lanes, in a fixed order, and vectors that number the lanes."""

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from recon.splat.cpu.lanes.kinds import DOUBLES, FLOATS, INT32, WIDTH, LanesType


def _order(lanes):
    return ir.Constant(ir.VectorType(INT32, len(lanes)), lanes)


def _reduce(builder, x, combine, width: int):
    """Combine the lanes in a tree."""
    undefined = ir.Constant(x.type, ir.Undefined)
    group = width
    while group > 1:
        group //= 2
        upper = _order([i + group if i < group else i for i in range(width)])
        x = combine(x, builder.shuffle_vector(x, undefined, upper))
    return builder.extract_element(x, ir.Constant(INT32, 0))


@intrinsic
def total(typing_context, x):
    """Sum of the lanes."""
    if not isinstance(x, LanesType):
        return None

    def generate(context, builder, signature, arguments):
        return _reduce(builder, arguments[0], builder.fadd, x.width)

    return x.element(x), generate


@intrinsic
def largest(typing_context, x):
    """Largest lane."""
    if not isinstance(x, LanesType):
        return None

    def generate(context, builder, signature, arguments):
        def larger(a, b):
            return builder.select(builder.fcmp_ordered(">", a, b), a, b)

        return _reduce(builder, arguments[0], larger, x.width)

    return x.element(x), generate


@intrinsic
def totals(typing_context, vectors):
    """Lane k of the result's j-th lanes is the sum of the lanes of vectors[16 j + k], a tuple; the rest 0."""
    if not isinstance(vectors, types.UniTuple) or vectors.dtype != FLOATS:
        return None
    kind = types.UniTuple(FLOATS, -(-vectors.count // WIDTH))

    def sixteen(builder, rows):
        group = WIDTH
        while group > 1:
            half = group // 2
            starts = range(0, 2 * WIDTH, group)
            low = _order([s + i for s in starts for i in range(half)])
            high = _order([s + half + i for s in starts for i in range(half)])
            if len(rows) % 2:
                rows.append(FLOATS.constant(0.0))
            rows = [
                builder.fadd(builder.shuffle_vector(x, y, low), builder.shuffle_vector(x, y, high))
                for x, y in zip(rows[::2], rows[1::2], strict=True)
            ]
            group = half
        return rows[0]

    def generate(context, builder, signature, arguments):
        rows = [builder.extract_value(arguments[0], i) for i in range(vectors.count)]
        sums = [sixteen(builder, rows[first : first + WIDTH]) for first in range(0, len(rows), WIDTH)]
        return context.make_tuple(builder, kind, sums)

    return kind(vectors), generate


def _pattern(kind: LanesType, values, meaning: str):
    @intrinsic
    def pattern(typing_context):
        def generate(context, builder, signature, arguments):
            return kind.constant(values)

        return kind(), generate

    pattern.__doc__ = meaning
    return pattern


lane_number = _pattern(DOUBLES, range(8), "0 1 2 3 4 5 6 7, in float64.")
lane_column = _pattern(
    FLOATS, [i % 8 for i in range(16)], "0..7 0..7: each lane's column when two rows of eight share a vector."
)
lane_row = _pattern(
    FLOATS, [i // 8 for i in range(16)], "Eight 0, eight 1: each lane's row when two rows share a vector."
)
