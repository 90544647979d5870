"""Spot meter reading of a pixel, as Markdown."""

import numpy as np

from recon.result.scene import Scene
from rig.terminal.text import number
from rig.view.pictures.layers import LAYERS, words_of
from rig.view.pictures.look import LUMINANCE, stops
from rig.view.pictures.painter import Drawing, compared_with
from rig.view.pictures.residuals import Residuals


def reading(
    drawing: Drawing, show: str, scene: Scene, row: int, column: int, residuals: Residuals | None = None
) -> str:
    """The light of a pixel in stops, in the units of the scene, and in cd/m2 where those are known.

    Args:
        drawing: Picture that is measured, with what it is compared with, and the layer in its place, if any.
        show: Name of what is shown: a layer, or one of the names in `rig.view.pictures.painter`.
        scene: Scene whose exposure defines middle grey, and whose scale of luminance, if known, gives cd/m2.
        row: Of the pixel, from the top.
        column: Of the pixel, from the left.
        residuals: What is known of the error of the scene.

    Returns:
        Lines of Markdown.
    """
    colour = drawing.light[row, column]
    luminance = float(colour @ LUMINANCE)
    above = float(stops(colour, scene.exposure))
    height, width = drawing.light.shape[:2]
    dark = above == -np.inf
    lines = ["**no light**" if dark else f"**{above:+.2f} stops** from middle grey"]
    error = None if residuals is None or dark else residuals.at(luminance)
    if error is not None:
        lines.append(f"**+- {number(error, 2)} stops**: 68 % of held-out pixels as bright are no further off")
    if scene.luminance_scale is not None and scene.luminance_error is not None:
        share = scene.luminance_error / scene.luminance_scale
        absolute = luminance * scene.luminance_scale
        lines.append(f"**{number(absolute)} cd/m2** +- {number(100 * share)} % by the scale")
    if drawing.over is not None:
        other = float(stops(drawing.over[row, column], scene.exposure))
        if np.isfinite(above - other):
            lines.append(f"**{above - other:+.3f} stops** over {compared_with(show)}")
    if drawing.layer is not None and show in LAYERS:
        lines.append(words_of(show, drawing.layer[row, column], scene))
    lines += [
        f"luminance {number(luminance)}",
        "R, G, B " + ", ".join(number(float(value)) for value in colour),
        f"column {column}, row {row} of {width}x{height}",
    ]
    return "  \n".join(lines)
