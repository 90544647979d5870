# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators, allow-subclassing-any
"""Sixteen float32 lanes as a Numba value: SIMD written out, not hoped for.

`Lanes` is an LLVM vector <16 x float>: one AVX-512 register, two of AVX2, four of SSE or NEON; LLVM
splits it by itself, so the same kernel runs everywhere. LLVM's own vectoriser handles the kernels of
this package only by accident (a changed mask made such a loop scalar and five times slower), and it
may not vectorise sums at all without leave to reorder them. All operations are strict IEEE ones.

In kernels: `+ - *` with Lanes (or Lanes and float32), `fma(a, b, c)` = a b + c, `minus(x)`, `splat(x)`,
`load(array, i)`, `store(array, i, x)`; masks from `at_least(a, b)` and `both(m, n)`, used by
`choose(mask, x, y)`; `maximum(x, y)`; over the lanes `total(x)`, `largest(x)`, `totals((x, y, ...))`.
"""

import operator
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.datamodel import PrimitiveModel
from numba.extending import intrinsic, overload, register_model

WIDTH = 16

_F = ir.FloatType()
_I = ir.IntType(32)
_VF = ir.VectorType(_F, WIDTH)
_VI = ir.VectorType(_I, WIDTH)
_VB = ir.VectorType(ir.IntType(1), WIDTH)


class LanesType(types.Type):
    """Numba type of sixteen float32."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


class MaskType(types.Type):
    """Numba type of sixteen booleans."""

    def __init__(self) -> None:
        super().__init__(name="LanesMask")


lanes_type = LanesType()
mask_type = MaskType()


@register_model(LanesType)
class _LanesModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VF)


@register_model(MaskType)
class _MaskModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VB)


def _spread(builder: Any, scalar: Any) -> Any:
    """A vector with the scalar in every lane."""
    kind = ir.VectorType(scalar.type, WIDTH)
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), scalar, ir.Constant(_I, 0))
    zeros = ir.Constant(ir.VectorType(_I, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(kind, ir.Undefined), zeros)


def _as_lanes(builder: Any, value: Any) -> Any:
    return value if isinstance(value.type, ir.VectorType) else _spread(builder, value)


def _accepts(*kinds: Any) -> bool:
    """Whether all are Lanes or float32, and one is Lanes."""
    return any(isinstance(k, LanesType) for k in kinds) and all(
        isinstance(k, LanesType) or k == types.float32 for k in kinds
    )


def _binary(name: str) -> Any:
    @intrinsic
    def operation(typing_context, a, b):
        def generate(context, builder, signature, arguments):
            left, right = (_as_lanes(builder, x) for x in arguments)
            return getattr(builder, name)(left, right)

        return lanes_type(a, b), generate

    return operation


_add, _sub, _mul, _div = _binary("fadd"), _binary("fsub"), _binary("fmul"), _binary("fdiv")


@overload(operator.add)
def _overload_add(a, b):
    if _accepts(a, b):
        return lambda a, b: _add(a, b)
    return None


@overload(operator.sub)
def _overload_sub(a, b):
    if _accepts(a, b):
        return lambda a, b: _sub(a, b)
    return None


@overload(operator.mul)
def _overload_mul(a, b):
    if _accepts(a, b):
        return lambda a, b: _mul(a, b)
    return None


@overload(operator.truediv)
def _overload_truediv(a, b):
    if _accepts(a, b):
        return lambda a, b: _div(a, b)
    return None


@intrinsic
def splat(typing_context, x):
    """All lanes equal to a float32."""

    def generate(context, builder, signature, arguments):
        return _spread(builder, arguments[0])

    return lanes_type(types.float32), generate


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Pointer to element `index` of a contiguous 1-d array."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VF.as_pointer())


@intrinsic
def load(typing_context, array, index):
    """Lanes from array[index : index + 16]; array: contiguous 1-d float32; unchecked."""

    def generate(context, builder, signature, arguments):
        pointer = _address(context, builder, signature.args[0], *arguments)
        return builder.load(pointer, align=4)

    return lanes_type(array, types.intp), generate


@intrinsic
def store(typing_context, array, index, x):
    """Write lanes to array[index : index + 16]."""

    def generate(context, builder, signature, arguments):
        pointer = _address(context, builder, signature.args[0], arguments[0], arguments[1])
        builder.store(arguments[2], pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), generate


def _first(builder, count):
    """Mask of the first `count` lanes."""
    numbers = ir.Constant(_VI, list(range(WIDTH)))
    return builder.icmp_signed("<", numbers, _spread(builder, builder.trunc(count, _I)))


@intrinsic
def load_first(typing_context, array, index, count):
    """Lanes from array[index : index + count], the others 0; what lies behind is not touched."""

    def generate(context, builder, signature, arguments):
        pointer = _address(context, builder, signature.args[0], arguments[0], arguments[1])
        mask = _first(builder, arguments[2])
        kind = ir.FunctionType(_VF, [pointer.type, _I, _VB, _VF])
        function = builder.module.declare_intrinsic("llvm.masked.load.v16f32.p0", fnty=kind)
        zeros = ir.Constant(_VF, [0.0] * WIDTH)
        return builder.call(function, [pointer, ir.Constant(_I, 4), mask, zeros])

    return lanes_type(array, types.intp, types.intp), generate


@intrinsic
def store_first(typing_context, array, index, count, x):
    """Write the first `count` lanes to array[index : index + count]."""

    def generate(context, builder, signature, arguments):
        pointer = _address(context, builder, signature.args[0], arguments[0], arguments[1])
        mask = _first(builder, arguments[2])
        kind = ir.FunctionType(ir.VoidType(), [_VF, pointer.type, _I, _VB])
        function = builder.module.declare_intrinsic("llvm.masked.store.v16f32.p0", fnty=kind)
        builder.call(function, [arguments[3], pointer, ir.Constant(_I, 4), mask])
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, lanes_type), generate


@intrinsic
def keep_first(typing_context, count, x):
    """`x` in the first `count` lanes, else 0."""

    def generate(context, builder, signature, arguments):
        zeros = ir.Constant(_VF, [0.0] * WIDTH)
        return builder.select(_first(builder, arguments[0]), arguments[1], zeros)

    return lanes_type(types.intp, lanes_type), generate


def _call(builder: Any, name: str, result: Any, arguments: list[Any]) -> Any:
    kind = ir.FunctionType(result, [a.type for a in arguments])
    function = builder.module.declare_intrinsic(name, fnty=kind)
    return builder.call(function, arguments)


@intrinsic
def fma(typing_context, a, b, c):
    """a b + c, fused where the machine can."""
    if not _accepts(a, b, c):
        return None

    def generate(context, builder, signature, arguments):
        values = [_as_lanes(builder, x) for x in arguments]
        return _call(builder, "llvm.fmuladd.v16f32", _VF, values)

    return lanes_type(a, b, c), generate


@intrinsic
def minus(typing_context, x):
    """-x."""

    def generate(context, builder, signature, arguments):
        return builder.fneg(arguments[0])

    return lanes_type(x), generate


def _compare(how: str) -> Any:
    @intrinsic
    def comparison(typing_context, a, b):
        def generate(context, builder, signature, arguments):
            left, right = (_as_lanes(builder, x) for x in arguments)
            return builder.fcmp_ordered(how, left, right)

        return mask_type(a, b), generate

    return comparison


at_least = _compare(">=")
above = _compare(">")


@intrinsic
def both(typing_context, a, b):
    """Mask: a and b."""

    def generate(context, builder, signature, arguments):
        return builder.and_(*arguments)

    return mask_type(mask_type, mask_type), generate


@intrinsic
def choose(typing_context, mask, a, b):
    """`a` where the mask is set, else `b`."""

    def generate(context, builder, signature, arguments):
        left, right = (_as_lanes(builder, x) for x in arguments[1:])
        return builder.select(arguments[0], left, right)

    return lanes_type(mask_type, a, b), generate


@intrinsic
def maximum(typing_context, a, b):
    """The larger; b where either is NaN."""

    def generate(context, builder, signature, arguments):
        left, right = (_as_lanes(builder, x) for x in arguments)
        return builder.select(builder.fcmp_ordered(">", left, right), left, right)

    return lanes_type(a, b), generate


def _halves(builder: Any, x: Any, combine: Any) -> Any:
    """Reduce the lanes in a fixed tree."""
    width = WIDTH
    undefined = ir.Constant(_VF, ir.Undefined)
    while width > 1:
        width //= 2
        order = [i + width if i < width else i for i in range(WIDTH)]
        other = builder.shuffle_vector(x, undefined, ir.Constant(_VI, order))
        x = combine(x, other)
    return builder.extract_element(x, ir.Constant(_I, 0))


@intrinsic
def total(typing_context, x):
    """Sum of the lanes."""

    def generate(context, builder, signature, arguments):
        return _halves(builder, arguments[0], builder.fadd)

    return types.float32(lanes_type), generate


@intrinsic
def largest(typing_context, x):
    """Largest lane."""

    def generate(context, builder, signature, arguments):
        def larger(a, b):
            return builder.select(builder.fcmp_ordered(">", a, b), a, b)

        return _halves(builder, arguments[0], larger)

    return types.float32(lanes_type), generate


_ROUNDING = 12582912.0
"""1.5 * 2^23: adding it to |t| < 2^22 leaves round(t) in the low bits of the sum."""


@intrinsic
def round_bits(typing_context, x):
    """x + 1.5 * 2^23, whose low bits are round(x); for `rounded` and `scale_by`."""

    def generate(context, builder, signature, arguments):
        return builder.fadd(arguments[0], ir.Constant(_VF, [_ROUNDING] * WIDTH))

    return lanes_type(lanes_type), generate


@intrinsic
def rounded(typing_context, bits):
    """round(x) from `round_bits(x)`."""

    def generate(context, builder, signature, arguments):
        return builder.fsub(arguments[0], ir.Constant(_VF, [_ROUNDING] * WIDTH))

    return lanes_type(lanes_type), generate


@intrinsic
def scale_by(typing_context, x, bits):
    """x * 2^round(t), bits = round_bits(t); exact while the result is a normal number, else garbage."""

    def generate(context, builder, signature, arguments):
        value = builder.bitcast(_as_lanes(builder, arguments[0]), _VI)
        shift = builder.shl(builder.bitcast(arguments[1], _VI), ir.Constant(_VI, [23] * WIDTH))
        return builder.bitcast(builder.add(value, shift), _VF)

    return lanes_type(x, lanes_type), generate


@intrinsic
def lane_column(typing_context):
    """0 1 2 3 4 5 6 7 0 1 2 3 4 5 6 7: the column of each lane when two rows of eight share a vector."""

    def generate(context, builder, signature, arguments):
        return ir.Constant(_VF, [float(i % 8) for i in range(WIDTH)])

    return lanes_type(), generate


@intrinsic
def lane_row(typing_context):
    """0 0 0 0 0 0 0 0 1 1 1 1 1 1 1 1: the row of each lane when two rows of eight share a vector."""

    def generate(context, builder, signature, arguments):
        return ir.Constant(_VF, [float(i // 8) for i in range(WIDTH)])

    return lanes_type(), generate


@intrinsic
def totals(typing_context, vectors):
    """Lane k is the sum of the lanes of vectors[k]; a tuple of at most sixteen, the rest 0."""

    def generate(context, builder, signature, arguments):
        rows = [builder.extract_value(arguments[0], i) for i in range(signature.args[0].count)]
        group = WIDTH
        while group > 1:
            half = group // 2
            starts = range(0, 2 * WIDTH, group)
            low = ir.Constant(_VI, [s + i for s in starts for i in range(half)])
            high = ir.Constant(_VI, [s + half + i for s in starts for i in range(half)])
            if len(rows) % 2:
                rows.append(ir.Constant(_VF, [0.0] * WIDTH))
            rows = [
                builder.fadd(builder.shuffle_vector(x, y, low), builder.shuffle_vector(x, y, high))
                for x, y in zip(rows[::2], rows[1::2], strict=True)
            ]
            group = half
        return rows[0]

    return lanes_type(vectors), generate
