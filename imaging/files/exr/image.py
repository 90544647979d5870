"""The content of an OpenEXR file: channels of linear light, and attributes that say which light."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from imaging.arrays import AnyArray, Array32
from imaging.errors import InputError
from imaging.files.exr import layers
from imaging.files.tags.exr_colour import colour_of
from imaging.optics.exposure import Exposure

Planes = Mapping[str, AnyArray]
"""Arrays [H, W] by the name of their channel."""
Attribute = str | float | tuple[float, ...]
ASPECT = "pixelAspectRatio"
STRUCTURE = {
    "channels",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    ASPECT,
    "screenWindowCenter",
    "screenWindowWidth",
    "type",
    "tiles",
    "version",
    "name",
    "chunkCount",
}
"""Attributes that say how the pixels are stored."""


@dataclass(frozen=True)
class ExrImage:
    """Channels, each float32 [H, W], by name, and the attributes that are text or numbers.

    light: names of the channels of the part that holds the light; None: all channels.
    """

    channels: dict[str, Array32]
    attributes: dict[str, Attribute] = field(default_factory=dict)
    light: frozenset[str] | None = None

    def rgb(self) -> Array32:
        """Linear Rec.709, float32 [H, W, 3], of the channels that are light (`imaging.files.exr.layers`).

        Another space of linear light that the file names is converted; one that names none is Rec.709.
        InputError if no channels, or several, could be the light, and if the file says that its R, G, B are
        data, or not linear (`imaging.files.tags.exr_colour`).
        """
        names = layers.light_channels(self._names)
        light = np.stack([self.channels[name] for name in names], axis=-1)
        matrix = colour_of(self.attributes).matrix if len(set(names)) == 3 else None
        return light if matrix is None else (light @ matrix.T).astype(np.float32)

    @property
    def alpha(self) -> Array32 | None:
        """Opacity of each pixel, 0..1, float32 [H, W]; None where all is opaque.

        The light of an EXR is multiplied by it: premultiplied, over black. InputError as `rgb`.
        """
        name = layers.alpha_channel(self._names)
        if not name:
            return None
        cover = np.nan_to_num(self.channels[name], nan=1.0).clip(0.0, 1.0)
        return None if (cover == 1).all() else np.asarray(cover, np.float32)

    @property
    def doubt(self) -> str:
        """A sentence if what the file says of its R, G, B or its pixels is not clear; else empty."""
        aspect = self.attributes.get(ASPECT, 1.0)
        if aspect != 1:
            return f"{ASPECT} {aspect:g} is not used: pixels count as square unless a lens is given."
        try:
            return colour_of(self.attributes).doubt
        except InputError:  # which `rgb` says, if there are R, G and B at all
            return ""

    @property
    def exposure(self) -> Exposure | None:
        """Exposure from `expTime`, `aperture` and `isoSpeed`; None if the file names no time."""
        time, f_number, iso = (self._positive(name) for name in ("expTime", "aperture", "isoSpeed"))
        return None if time is None else Exposure(time=time, f_number=f_number, iso=iso)

    @property
    def _names(self) -> frozenset[str]:
        return frozenset(self.channels) if self.light is None else self.light

    def _positive(self, name: str) -> float | None:
        value = self.attributes.get(name)
        return value if isinstance(value, float) and 0 < value < float("inf") else None
