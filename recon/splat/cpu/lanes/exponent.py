# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
"""Powers of two by integer arithmetic on the bits of floats."""

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from recon.splat.cpu.lanes.kinds import DOUBLES, FLOATS, as_lanes, common

_ROUNDING = 12582912.0
"""1.5 * 2^23: adding it to |t| < 2^22 leaves round(t) in the low bits of the float32 sum."""


@intrinsic
def round_bits(typing_context, x):
    """x + 1.5 * 2^23 (float32), whose low bits are round(x); for `rounded` and `scale_by`."""
    if x != FLOATS:
        return None

    def generate(context, builder, signature, arguments):
        return builder.fadd(arguments[0], FLOATS.constant(_ROUNDING))

    return FLOATS(x), generate


@intrinsic
def rounded(typing_context, bits):
    """round(x) from `round_bits(x)`."""
    if bits != FLOATS:
        return None

    def generate(context, builder, signature, arguments):
        return builder.fsub(arguments[0], FLOATS.constant(_ROUNDING))

    return FLOATS(bits), generate


@intrinsic
def scale_by(typing_context, x, bits):
    """x * 2^round(t), bits = round_bits(t); exact while the result is a normal number, else garbage."""
    if bits != FLOATS or common(x, bits) is None:
        return None

    def generate(context, builder, signature, arguments):
        value = builder.bitcast(as_lanes(builder, arguments[0], FLOATS), FLOATS.whole)
        places = ir.Constant(FLOATS.whole, [23] * FLOATS.width)
        shift = builder.shl(builder.bitcast(arguments[1], FLOATS.whole), places)
        return builder.bitcast(builder.add(value, shift), FLOATS.vector)

    return FLOATS(x, bits), generate


@intrinsic
def split_exponent(typing_context, x):
    """(m, e) with x = m 2^e and sqrt(1/2) <= m < sqrt(2), for positive normal float64 lanes."""
    if x != DOUBLES:
        return None

    def generate(context, builder, signature, arguments):
        def every(value):
            return ir.Constant(DOUBLES.whole, [value] * DOUBLES.width)

        bits = builder.bitcast(arguments[0], DOUBLES.whole)
        # Subtracting sqrt(1/2) first makes the exponent step there, not at 1.
        half_root = 0x3FE6A09E667F3BCD
        offset = builder.sub(bits, every(half_root))
        exponent = builder.ashr(offset, every(52))
        mantissa = builder.sub(bits, builder.shl(exponent, every(52)))
        pair = context.make_tuple(
            builder,
            signature.return_type,
            [builder.bitcast(mantissa, DOUBLES.vector), builder.sitofp(exponent, DOUBLES.vector)],
        )
        return pair

    return types.UniTuple(DOUBLES, 2)(x), generate
