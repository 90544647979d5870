"""Selection of the light among an EXR's layers, views and passes.

Names are those of OpenEXR ("Standard channel names"): R, G, B, or Y alone; before them LAYER and a dot.
"""

from collections.abc import Collection

from imaging.errors import InputError

COLOURS = ("R", "G", "B")
_PICTURES = ("combined", "beauty", "rgba")
"""Last parts of the names of layers that hold the picture itself, of which others are components."""


def light_channels(names: Collection[str]) -> tuple[str, str, str]:
    """The channels that are red, green and blue light; InputError where none or several could be.

    Those without a layer come first; of several layers the one that is called Combined, beauty or RGBA.
    """
    if all(name in names for name in COLOURS):
        return COLOURS
    if "Y" in names:
        return _grey(names)
    layers = sorted({name[:-2] for name in names if name.endswith(".R")})
    layers = [layer for layer in layers if all(f"{layer}.{colour}" in names for colour in COLOURS)]
    if len(layers) > 1:
        pictures = [layer for layer in layers if is_picture(layer)]
        if len(pictures) != 1:
            raise InputError(
                f"the EXR has the layers {', '.join(layers)}, and none or several of them are the picture: "
                "export one of them as R, G and B."
            )
        layers = pictures
    if layers:
        red, green, blue = (f"{layers[0]}.{colour}" for colour in COLOURS)
        return red, green, blue
    listed = ", ".join(sorted(names))
    raise InputError(f"the EXR has channels {listed}, but neither R, G, B nor Y: export it as RGB.")


def is_picture(layer: str) -> bool:
    """Return whether a layer, or a part of a file, is called as the picture itself is."""
    return layer.rpartition(".")[2].casefold() in _PICTURES


def holds_light(names: Collection[str]) -> bool:
    """Return whether `light_channels` finds any."""
    try:
        light_channels(names)
    except InputError:
        return False
    return True


def alpha_channel(names: Collection[str]) -> str:
    """The channel that is the alpha of the light, '' where it has none; InputError as `light_channels`."""
    layer = light_channels(names)[0][:-1]
    if f"{layer}A" not in names and any(f"{layer}A{colour}" in names for colour in COLOURS):
        raise InputError("the EXR has an alpha for each colour (AR, AG, AB): export it with one, A.")
    return f"{layer}A" if f"{layer}A" in names else ""


def depth_channel(names: Collection[str]) -> str:
    """The channel that is depth: Z, depth.Z, Y, R, or that of the one layer called depth; '' for none.

    Beside X, a Z and a Y are those of places.
    """
    if "X" not in names:
        for name in ("Z", "depth.Z", "Y", "R"):
            if name in names:
                return name
    layered = [name for name in names if name.casefold().endswith((".depth.z", ".depth.v"))]
    return layered[0] if len(layered) == 1 else ""


def _grey(names: Collection[str]) -> tuple[str, str, str]:
    if "RY" in names or "BY" in names:
        raise InputError("the EXR is in luminance and chroma (Y, RY, BY): export it as RGB.")
    if "X" in names:
        raise InputError(
            "the EXR has channels X and Y, which may be CIE XYZ, positions or motion, and no R, G, B: "
            "export the light as RGB."
        )
    return ("Y", "Y", "Y")
