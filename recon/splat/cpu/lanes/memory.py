# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Lanes from and to contiguous 1-d arrays; no index is checked."""

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from recon.splat.cpu.lanes.kinds import INT32, LanesType, call, kind_of, spread


@intrinsic
def splat(typing_context, x):
    """All lanes equal to a float32 or a float64."""
    kind = kind_of(x)
    if kind is None:
        return None

    def generate(context, builder, signature, arguments):
        return spread(builder, arguments[0], kind.width)

    return kind(x), generate


def _lanes_in(array) -> LanesType | None:
    return kind_of(array.dtype) if isinstance(array, types.Array) and array.ndim == 1 else None


def place_of(context, builder, kind: LanesType, array_type, array, index):
    """Address of array[index], as a pointer to lanes."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), kind.vector.as_pointer())


def _align(kind: LanesType) -> int:
    return 4 if kind.width == 16 else 8


def _first(builder, count, kind: LanesType):
    """Mask of the first `count` lanes."""
    numbers = ir.Constant(ir.VectorType(INT32, kind.width), list(range(kind.width)))
    return builder.icmp_signed("<", numbers, spread(builder, builder.trunc(count, INT32), kind.width))


@intrinsic
def load(typing_context, array, index):
    """Lanes from array[index :]."""
    kind = _lanes_in(array)
    if kind is None:
        return None

    def generate(context, builder, signature, arguments):
        return builder.load(place_of(context, builder, kind, array, *arguments), align=_align(kind))

    return kind(array, types.intp), generate


@intrinsic
def store(typing_context, array, index, x):
    """Write lanes to array[index :]."""
    kind = _lanes_in(array)
    if kind is None or kind != x:
        return None

    def generate(context, builder, signature, arguments):
        pointer = place_of(context, builder, kind, array, *arguments[:2])
        builder.store(arguments[2], pointer, align=_align(kind))
        return context.get_dummy_value()

    return types.void(array, types.intp, x), generate


@intrinsic
def load_first(typing_context, array, index, count):
    """Lanes from array[index : index + count], the others 0; what lies behind is not touched."""
    kind = _lanes_in(array)
    if kind is None:
        return None

    def generate(context, builder, signature, arguments):
        pointer = place_of(context, builder, kind, array, *arguments[:2])
        values = [pointer, ir.Constant(INT32, _align(kind)), _first(builder, arguments[2], kind)]
        name = f"llvm.masked.load.{kind.suffix()}.p0"
        return call(builder, name, kind.vector, [*values, kind.constant(0.0)])

    return kind(array, types.intp, types.intp), generate


@intrinsic
def store_first(typing_context, array, index, count, x):
    """Write the first `count` lanes to array[index : index + count]."""
    kind = _lanes_in(array)
    if kind is None or kind != x:
        return None

    def generate(context, builder, signature, arguments):
        pointer = place_of(context, builder, kind, array, *arguments[:2])
        mask = _first(builder, arguments[2], kind)
        values = [arguments[3], pointer, ir.Constant(INT32, _align(kind)), mask]
        call(builder, f"llvm.masked.store.{kind.suffix()}.p0", ir.VoidType(), values)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, x), generate


@intrinsic
def keep_first(typing_context, count, x):
    """`x` in the first `count` lanes, else 0."""
    if not isinstance(x, LanesType):
        return None

    def generate(context, builder, signature, arguments):
        return builder.select(_first(builder, arguments[0], x), arguments[1], x.constant(0.0))

    return x(types.intp, x), generate
