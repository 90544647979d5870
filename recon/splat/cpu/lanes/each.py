# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Operations on a tuple of lanes, one for each channel of light: written out, since their number is a type.

A loop over channels would keep them in memory; a tuple's are values, which LLVM keeps in registers.
"""

from numba import types
from numba.extending import intrinsic

from recon.splat.cpu.lanes.kinds import FLOATS, as_lanes, call
from recon.splat.cpu.lanes.memory import place_of


def _of_floats(values) -> bool:
    return isinstance(values, types.UniTuple) and values.dtype == FLOATS


def _numbers(array) -> bool:
    return isinstance(array, types.Array) and array.ndim == 1 and array.dtype == types.float32


def _fma(builder, a, b, c):
    return call(builder, "llvm.fmuladd.v16f32", FLOATS.vector, [a, b, c])


def _number(context, builder, array_type, array, index, offset: int):
    """A scalar of an array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.load(builder.gep(data, [builder.add(index, index.type(offset))]))


@intrinsic
def load_each(typing_context, array, index, step, like):
    """Load as many lanes as the tuple `like` has members: the k-th from array[index + k step :]."""
    if not _numbers(array) or not isinstance(like, types.BaseTuple):
        return None
    kind = types.UniTuple(FLOATS, len(like))

    def generate(context, builder, signature, arguments):
        data, place, stride = arguments[:3]
        loaded = []
        for _ in range(len(like)):
            loaded.append(builder.load(place_of(context, builder, FLOATS, array, data, place), align=4))
            place = builder.add(place, stride)
        return context.make_tuple(builder, kind, loaded)

    return kind(array, types.intp, types.intp, like), generate


@intrinsic
def store_each(typing_context, array, index, step, values):
    """Write the k-th lanes of a tuple to array[index + k step :]."""
    if not _numbers(array) or not _of_floats(values):
        return None

    def generate(context, builder, signature, arguments):
        data, place, stride, lanes = arguments
        for k in range(values.count):
            pointer = place_of(context, builder, FLOATS, array, data, place)
            builder.store(builder.extract_value(lanes, k), pointer, align=4)
            place = builder.add(place, stride)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, values), generate


@intrinsic
def fma_each(typing_context, x, array, index, sums):
    """Compute x array[index + k] + sums[k] for each k."""
    if x != FLOATS or not _numbers(array) or not _of_floats(sums):
        return None

    def generate(context, builder, signature, arguments):
        value, data, place, lanes = arguments
        added = []
        for k in range(sums.count):
            scalar = as_lanes(builder, _number(context, builder, array, data, place, k), FLOATS)
            added.append(_fma(builder, value, scalar, builder.extract_value(lanes, k)))
        return context.make_tuple(builder, sums, added)

    return sums(x, array, types.intp, sums), generate


@intrinsic
def dot_each(typing_context, values, array, index, start):
    """start + the sum over k of values[k] array[index + k], the last k first."""
    if start != FLOATS or not _numbers(array) or not _of_floats(values):
        return None

    def generate(context, builder, signature, arguments):
        lanes, data, place, total = arguments
        for k in reversed(range(values.count)):
            scalar = as_lanes(builder, _number(context, builder, array, data, place, k), FLOATS)
            total = _fma(builder, builder.extract_value(lanes, k), scalar, total)
        return total

    return FLOATS(values, array, types.intp, start), generate


@intrinsic
def times_each(typing_context, x, values):
    """Compute x values[k] for each k."""
    if x != FLOATS or not _of_floats(values):
        return None

    def generate(context, builder, signature, arguments):
        value, lanes = arguments
        products = [builder.fmul(value, builder.extract_value(lanes, k)) for k in range(values.count)]
        return context.make_tuple(builder, values, products)

    return values(x, values), generate


@intrinsic
def plus_each(typing_context, a, b):
    """Compute a[k] + b[k] for each k."""
    if not _of_floats(a) or a != b:
        return None

    def generate(context, builder, signature, arguments):
        left, right = arguments
        pairs = [(builder.extract_value(left, k), builder.extract_value(right, k)) for k in range(a.count)]
        return context.make_tuple(builder, a, [builder.fadd(x, y) for x, y in pairs])

    return a(a, b), generate
