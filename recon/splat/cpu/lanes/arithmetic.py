# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
# mypy: allow-subclassing-any
"""Operations lane by lane."""

import operator
from typing import ClassVar

from numba import types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin

from recon.splat.cpu.lanes.kinds import DOUBLES, MASKS, LanesType, MaskType, as_lanes, call, common


def _operator(function, name: str) -> None:
    """Teach Numba an operator of Python on lanes; directly, since an @overload compiles a function each."""

    @infer_global(function)
    class _Typing(AbstractTemplate):
        # More special than Numba's own templates, which are many: tried before them.
        metadata: ClassVar[dict[str, str]] = {"target": "cpu"}

        def generic(self, args, kws):
            kind = common(*args) if len(args) == 2 and not kws else None
            return None if kind is None else signature(kind, *args)

    def generate(context, builder, sig, arguments):
        kind = sig.return_type
        left, right = (as_lanes(builder, x, kind) for x in arguments)
        # Kernels on float32 say where they fuse; those on float64 leave it to LLVM.
        return getattr(builder, name)(left, right, flags=("contract",) if kind == DOUBLES else ())

    for kinds in ((LanesType, LanesType), (LanesType, types.Float), (types.Float, LanesType)):
        lower_builtin(function, *kinds)(generate)


_operator(operator.add, "fadd")
_operator(operator.sub, "fsub")
_operator(operator.mul, "fmul")
_operator(operator.truediv, "fdiv")


@intrinsic
def fma(typing_context, a, b, c):
    """a b + c, fused where the machine can."""
    kind = common(a, b, c)
    if kind is None:
        return None

    def generate(context, builder, signature, arguments):
        values = [as_lanes(builder, x, kind) for x in arguments]
        return call(builder, f"llvm.fmuladd.{kind.suffix()}", kind.vector, values)

    return kind(a, b, c), generate


def _unary(llvm: str, meaning: str):
    @intrinsic
    def operation(typing_context, x):
        if not isinstance(x, LanesType):
            return None

        def generate(context, builder, signature, arguments):
            return call(builder, f"llvm.{llvm}.{x.suffix()}", x.vector, arguments)

        return x(x), generate

    operation.__doc__ = meaning
    return operation


root = _unary("sqrt", "The square root.")
floor = _unary("floor", "The largest whole number that is not above.")
ceiling = _unary("ceil", "The smallest whole number that is not below.")
absolute = _unary("fabs", "Without its sign.")


@intrinsic
def minus(typing_context, x):
    """-x."""
    if not isinstance(x, LanesType):
        return None

    def generate(context, builder, signature, arguments):
        return builder.fneg(arguments[0])

    return x(x), generate


def _compare(how: str):
    @intrinsic
    def comparison(typing_context, a, b):
        kind = common(a, b)
        if kind is None:
            return None

        def generate(context, builder, signature, arguments):
            left, right = (as_lanes(builder, x, kind) for x in arguments)
            return builder.fcmp_ordered(how, left, right)

        return MASKS[kind.width](a, b), generate

    return comparison


at_least = _compare(">=")
above = _compare(">")


@intrinsic
def both(typing_context, a, b):
    """Mask: a and b."""
    if not isinstance(a, MaskType) or a != b:
        return None

    def generate(context, builder, signature, arguments):
        return builder.and_(*arguments)

    return a(a, b), generate


@intrinsic
def choose(typing_context, mask, a, b):
    """`a` where the mask is set, else `b`; a mask and two lanes, or lanes and a scalar."""
    kind = common(a, b)
    if kind is None or mask != MASKS[kind.width]:
        return None

    def generate(context, builder, signature, arguments):
        left, right = (as_lanes(builder, x, kind) for x in arguments[1:])
        return builder.select(arguments[0], left, right)

    return kind(mask, a, b), generate


def _extreme(how: str, meaning: str):
    @intrinsic
    def operation(typing_context, a, b):
        kind = common(a, b)
        if kind is None:
            return None

        def generate(context, builder, signature, arguments):
            left, right = (as_lanes(builder, x, kind) for x in arguments)
            return builder.select(builder.fcmp_ordered(how, left, right), left, right)

        return kind(a, b), generate

    operation.__doc__ = meaning
    return operation


maximum = _extreme(">", "The larger; b where either is NaN.")
minimum = _extreme("<", "The smaller; b where either is NaN.")
