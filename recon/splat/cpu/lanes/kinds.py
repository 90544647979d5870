# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls, allow-untyped-decorators
# mypy: allow-subclassing-any
"""The Numba types of lanes and masks, and what every operation on them needs."""

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.datamodel import PrimitiveModel
from numba.extending import register_model

WIDTH = 16
"""Lanes of float32."""
WIDTH_64 = 8
"""Lanes of float64."""

INT32 = ir.IntType(32)


class LanesType(types.Type):
    """Numba type of sixteen float32 or eight float64."""

    def __init__(self, element) -> None:
        self.element = element
        self.width = WIDTH if element == types.float32 else WIDTH_64
        super().__init__(name=f"Lanes({element})")

    @property
    def vector(self):
        """The LLVM type."""
        return ir.VectorType(ir.FloatType() if self.width == WIDTH else ir.DoubleType(), self.width)

    @property
    def whole(self):
        """The LLVM type of as many integers of the same size."""
        return ir.VectorType(ir.IntType(32 if self.width == WIDTH else 64), self.width)

    def constant(self, values):
        """An LLVM constant from a number, or a number for each lane."""
        listed = [values] * self.width if isinstance(values, (int, float)) else list(values)
        return ir.Constant(self.vector, [float(value) for value in listed])

    def suffix(self) -> str:
        """Return how LLVM names the type in its intrinsics."""
        return "v16f32" if self.width == WIDTH else "v8f64"


class MaskType(types.Type):
    """Numba type of a boolean for each lane."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(name=f"LanesMask({width})")


FLOATS = LanesType(types.float32)
DOUBLES = LanesType(types.float64)
MASKS = {WIDTH: MaskType(WIDTH), WIDTH_64: MaskType(WIDTH_64)}


@register_model(LanesType)
class _LanesModel(PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, kind.vector)


@register_model(MaskType)
class _MaskModel(PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.width))


def kind_of(element) -> LanesType | None:
    """The lanes of a scalar type, or None."""
    return {types.float32: FLOATS, types.float64: DOUBLES}.get(element)


def common(*kinds) -> LanesType | None:
    """The one kind of lanes among the types; None without lanes, or if a scalar is of another kind."""
    lanes = [kind for kind in kinds if isinstance(kind, LanesType)]
    if not lanes or any(kind != lanes[0] and kind != lanes[0].element for kind in kinds):
        return None
    return lanes[0]


def spread(builder, scalar, width: int):
    """A vector with the scalar in every lane."""
    kind = ir.VectorType(scalar.type, width)
    undefined = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(undefined, scalar, ir.Constant(INT32, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(INT32, width), [0] * width))


def as_lanes(builder, value, kind: LanesType):
    """The value, spread over the lanes if it is a scalar."""
    return value if isinstance(value.type, ir.VectorType) else spread(builder, value, kind.width)


def call(builder, name: str, result, arguments):
    """Call an LLVM intrinsic."""
    function_type = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(builder.module.declare_intrinsic(name, fnty=function_type), arguments)
