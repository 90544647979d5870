"""Depth that was measured beside a photograph, and the one scale that brings it to the scene's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from imaging.arrays import Array, Array32, Integers
from imaging.files.depth import read_depth
from imaging.robust import robust_scale
from recon.data.geometry import inside, project

if TYPE_CHECKING:
    from recon.data.dataset import View


FEWEST_LOOKS = 30
"""Fewest samples at scene points, of all views together, that determine a scale."""
MOST_SCATTER = 0.1
"""Largest scatter of ln depth for maps and scene points of one scene: monocular guesses scatter more."""
SURFACE = 1.1
"""Times the nearest of four neighbouring pixels, within which all are of one surface."""
MOST_POINTS = 20_000
"""Most scene points that are projected where no view records which of them it saw."""


@dataclass(frozen=True)
class DepthMapFile:
    """A depth map on the disk. unit: what 1 in it is, in scene coordinates. Each look reads it anew."""

    path: Path
    unit: float

    def read(self, view: "View") -> Array32:
        """Depth along the view's axis, scene coordinates, float32 [H, W]; 0 where nothing is known.

        What a mask hides or alpha leaves out is not known. InputError where the file is missing or damaged.
        """
        values, _ = read_depth(self.path)
        depth = _resized(values, view.lens.height, view.lens.width) * np.float32(self.unit)
        known = view.valid & np.isfinite(depth)
        if (alpha := view.alpha) is not None:
            known &= alpha > 0.5
        return np.asarray(np.where(known, depth, 0), np.float32)


def _resized(values: Array32, height: int, width: int) -> Array32:
    """A map [h, w] at [height, width]: bilinear on a surface, else the nearest pixel, as nothing is between a
    near one and a far one.
    """
    shape = height, width
    if values.shape == shape:
        return values
    places = [(np.arange(n) + 0.5) * side / n for side, n in zip(values.shape, shape, strict=True)]
    nearest = values[np.ix_(*(place.astype(int) for place in places))]
    before = [np.floor(place - 0.5) for place in places]
    down, right = (
        (place - 0.5 - first).astype(np.float32) for place, first in zip(places, before, strict=True)
    )
    rows, columns = (
        [(first + step).clip(0, side - 1).astype(int) for step in (0, 1)]
        for first, side in zip(before, values.shape, strict=True)
    )
    four = [[values[np.ix_(row, column)] for column in columns] for row in rows]
    upper, lower = ((1 - right) * left + right * beside for left, beside in four)
    least, most = (np.minimum.reduce(four[0] + four[1]), np.maximum.reduce(four[0] + four[1]))
    surface = (least > 0) & (most < SURFACE * least)
    return np.where(surface, (1 - down)[:, None] * upper + down[:, None] * lower, nearest)


@dataclass(frozen=True)
class DepthFit:
    """Agreement of the depth maps of training views with the scene points.

    views: with a map. scale: what their units are to be multiplied by. scatter: standard deviation of ln
    depth about that, robust. looks: at scene points.
    """

    views: int
    scale: float
    scatter: float
    looks: int

    @property
    def fits(self) -> bool:
        """True if the maps hold depths of this scene."""
        return self.looks >= FEWEST_LOOKS and self.scatter <= MOST_SCATTER

    def summary(self) -> str:
        """Return what was found, to stand in a sentence."""
        maps = f"{self.views} training view{'' if self.views == 1 else 's'} with a depth map"
        if self.looks < FEWEST_LOOKS:
            return (
                f"{maps} look at {self.looks} scene points, and {FEWEST_LOOKS} are needed to find their scale"
            )
        agreed = f"{maps}, {self.scale:.4g} times what their unit says by {self.looks} looks at scene points"
        return f"{agreed}, which scatter by {100 * self.scatter:.2g} %"


def fit(views: Sequence["View"], xyz: Array, tracks: Mapping[str, Integers]) -> DepthFit | None:
    """Fit the scale of the depth maps of `views`; None if no view has one.

    xyz: scene points [P, 3]; tracks: which of them the image of each name saw, as far as that is known. One
    scale for all: maps that need a scale each are no measurement.
    """
    ratios: list[Array] = []
    maps = [view for view in views if view.depth is not None]
    for view in maps:
        assert view.depth is not None
        rows = tracks.get(view.id.image_name)
        points = xyz[:: 1 + len(xyz) // MOST_POINTS] if rows is None or not len(rows) else xyz[rows]
        pixels, away = project(view.lens, points)
        shown = inside(view.lens, pixels, away)
        x, y = pixels[shown].astype(int).T
        depth = view.depth.read(view)[y, x].astype(np.float64)
        ratios.append(np.log(away[shown][depth > 0]) - np.log(depth[depth > 0]))
    if not maps:
        return None
    together = np.concatenate(ratios)
    if not len(together):
        return DepthFit(len(maps), 1.0, 0.0, 0)
    middle = float(np.median(together))
    return DepthFit(len(maps), float(np.exp(middle)), robust_scale(together - middle), len(together))


def scaled(view: "View", scale: float | None) -> "View":
    """Multiply the depth map of a view, if it has one, by a scale; None drops it."""
    if view.depth is None:
        return view
    return replace(view, depth=None if scale is None else replace(view.depth, unit=view.depth.unit * scale))
