"""A lens of `rig` that sees what a lens of another model does, which has terms more than `rig` has."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

from capture.imports.layouts.given import lens_of
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.optics.lens import BROWN_TERMS, FISHEYE_TERMS, Lens, LensModel, project

FARTHEST_OFF = 1.0
"""Pixels by which the lens may differ anywhere in the picture."""
_GRID = (25, 17)
_ROUNDS = 200
_SAME = 1e-3
"""Pixels by which a ray may miss the place that it was sought for."""


def nearest_lens(
    image_of: Callable[[Array], Array],
    size: tuple[int, int],
    centred: tuple[float, float, float, float],
    where: str,
) -> tuple[Lens | None, float]:
    """The lens of `rig` nearest to one of another model.

    Args:
        image_of: Function of the other lens, from tangents (x/z, y/z) [N, 2] to pixels [N, 2].
        size: Width and height of the pictures, px.
        centred: fx, fy, cx, cy of the other lens, px.
        where: Name of the place in the layout, as `lens_of` takes it.

    Returns:
        The lens and its miss, px, at the farthest. The lens is None where every model misses by more than
        FARTHEST_OFF, where the nearest is out of proportion to the size, or where the other lens does not
        reach all of the picture; the miss is then infinite in the last case.
    """
    focal, centre = np.array(centred[:2]), np.array(centred[2:])
    across, down = (np.linspace(0.0, side, count) for side, count in zip(size, _GRID, strict=True))
    wanted = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    tangents = (wanted - centre) / focal
    with np.errstate(all="ignore"):
        for _ in range(_ROUNDS):
            off = image_of(tangents) - wanted
            if not np.isfinite(off).all() or np.abs(off).max() < _SAME / 10:
                break
            tangents = tangents - off / focal
        seen_at = image_of(tangents)
    if not np.abs(seen_at - wanted).max() < _SAME:
        return None, np.inf
    rays = np.concatenate([tangents, np.ones((len(tangents), 1))], axis=1)
    best, miss = None, np.inf
    models: tuple[tuple[LensModel, tuple[str, ...]], ...] = (
        ("OPENCV", BROWN_TERMS),
        ("OPENCV_FISHEYE", FISHEYE_TERMS),
    )
    for model, names in models:
        # Only where the terms alone do not reach, the focal length and the centre move as well.
        for free in (names[4:], names):
            held = dict(zip(names, [*centred, 0.0, 0.0, 0.0, 0.0], strict=True))

            def lens_with(values: Array) -> Lens:
                terms = held | dict(zip(free, values.tolist(), strict=True))  # noqa: B023
                return Lens.model_construct(model=model, width=size[0], height=size[1], **terms)  # noqa: B023

            def off_by(values: Array) -> Array:
                return np.nan_to_num((project(lens_with(values), rays) - wanted).ravel(), nan=1e6)

            solution = least_squares(off_by, [held[name] for name in free], x_scale="jac")
            farthest = float(np.abs(solution.fun).max())
            if farthest < miss:
                best, miss = lens_with(solution.x), farthest
            if miss < FARTHEST_OFF / 10:
                break
        if miss < FARTHEST_OFF / 10:
            break
    if best is None or miss > FARTHEST_OFF:
        return None, miss
    try:
        return lens_of(best.model, size, dict(zip(best.names, best.terms, strict=True)), where), miss
    except InputError:
        return None, miss
