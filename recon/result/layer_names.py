"""Names of the layers of data beside the light of a scene."""

from typing import Literal, get_args

Layer = Literal["depth", "alpha", "normal", "trust"]
LAYERS: tuple[Layer, ...] = get_args(Layer)
