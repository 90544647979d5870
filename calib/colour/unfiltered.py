"""Spectral mixture of unfiltered photosites from those with a filter, measured in the scene.

Files that name no row for W leave it to be guessed as the sum of the others; silicon and glass decide.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.data.views import View, read_view
from calib.light.radiometry import Radiometry
from calib.sensor.metadata import CameraSensor
from imaging.arrays import Array
from imaging.merge.linear_frame import LinearFrame
from imaging.sensor.cfa import cell_means
from imaging.sensor.mosaic import as_matrix
from imaging.session.records import Rung
from imaging.session.session import Session

NAME = "unfiltered"
VIEWS = 6
"""Number of views of each camera; all would take longer and be no more accurate."""
SMOOTH = 0.2
"""Relative step to the neighbours above which a cell lies at an edge: its photosites see other light."""
BRIGHT = 0.02
"""Signal below which noise is too great a part of it."""
CLEAR = 3.0
"""Ratio of squares to those of noise alone above which a mixture of R, G and B is measurable: the rest
stays.
"""
FEWEST = 500
"""Fewest cells; fewer determine the shares no better than files do."""
_ROUNDS = 5


def measured(
    session: Session, views: Sequence[View], sensors: Mapping[str, CameraSensor], light: Radiometry
) -> dict[str, CameraSensor]:
    """The cameras with the row of W as their shots of the scene show it.

    Args:
        session: Session of the views.
        views: Views of the scene, of which `VIEWS` of each camera are read.
        sensors: Sensors by camera name; those without W or without a matrix stay as they are.
        light: Exposure scales and responses with which files are read.

    Returns:
        Sensors by camera name, with the row of W replaced where enough cells determine it.

    Raises:
        InputError: A file is missing or damaged.
    """
    updated = dict(sensors)
    for name, sensor in sensors.items():
        camera_views = [view for view in views if view.camera.name == name]
        if sensor.camera_from_rec709 is None or len(sensor.camera_from_rec709) != 4 or not camera_views:
            continue
        rows = np.asarray(sensor.camera_from_rec709, np.float64)
        places = np.unique(np.linspace(0, len(camera_views) - 1, VIEWS).round().astype(int))
        found_cells = [
            smooth_cells(frame)
            for place in places
            for frame in read_view(session, camera_views[place], light.scale, light.responses[name])
        ]
        cells, noise = (np.concatenate(parts) for parts in zip(*found_cells, strict=True))
        if len(cells) >= FEWEST:
            before = rows[3] @ np.linalg.inv(rows[:3])
            after = mixture(cells, noise, before)
            white = (after @ rows[:3])[None]
            change = float(np.linalg.norm(white - rows[3:]) / np.linalg.norm(rows[3]))
            matrix = as_matrix(np.concatenate([rows[:3], white]))
            updated[name] = replace(sensor, camera_from_rec709=matrix, white_change=change)
    return updated


def rungs(sensors: Mapping[str, CameraSensor]) -> tuple[Rung, ...]:
    """Return how far the rows of W were off, where they were measured."""
    changes = [one.white_change for one in sensors.values() if one.white_change is not None]
    if not changes:
        return ()
    reason = (
        "what photosites without a filter see of red, green and blue is measured in the scene; files were "
        f"off by {100 * max(changes):.1f} % at most"
    )
    return (Rung(name=NAME, taken=True, reason=reason),)


def smooth_cells(frame: LinearFrame) -> tuple[Array, Array]:
    """R, G, B and W of the cells that are bright, smooth and not saturated, and their variances, [n, 4] each.

    The frame is a mosaic with W. Variances are 0 where its noise is not known.
    """
    assert frame.cfa is not None
    cells = cell_means(frame.signal, frame.cfa).astype(np.float64)
    spoilt = cell_means((frame.saturated | ~frame.valid).astype(np.float32), frame.cfa).max(-1) > 0
    white = cells[..., 3]
    padded = np.pad(white, 1, mode="edge")
    step = np.zeros(white.shape)
    for row, column in ((0, 1), (2, 1), (1, 0), (1, 2)):
        beside = padded[row : row + white.shape[0], column : column + white.shape[1]]
        step = np.maximum(step, np.abs(beside - white))
    cells = np.asarray(cells[~spoilt & (white > BRIGHT) & (step < SMOOTH * white)])
    period = frame.cfa.pattern
    sites = np.bincount(period.reshape(-1), minlength=4) * frame.cfa.cell**2 / period.size
    return cells, np.zeros(cells.shape) if frame.noise is None else frame.noise.variance(cells) / sites


def mixture(cells: Array, noise: Array, before: Array) -> Array:
    """Shares of R, G and B [3] that make up W in cells [n, 4], by robust least squares of relative errors.

    noise: variances of the cells; what they add to the squares of R, G and B, which would draw the shares
    towards nothing, is taken out. before: the prior shares, for cells that do not determine them, as of a
    scene that is all grey.
    """
    design, target = cells[:, :3] / cells[:, 3:], np.ones(len(cells))
    added = noise[:, :3] / cells[:, 3:] ** 2
    shares = np.asarray(before, np.float64).copy()
    for _ in range(_ROUNDS):
        residual = target - design @ shares
        spread = max(1.4826 * float(np.median(np.abs(residual - np.median(residual)))), 1e-6)
        weight = spread / np.maximum(np.abs(residual), 2 * spread)
        weighted = design * weight[:, None]
        squares = weighted.T @ design
        # In units of what noise adds to the squares, they show which mixtures of R, G and B it hides.
        unit = np.sqrt(np.maximum((added * weight[:, None]).sum(0), 1e-6 * np.diag(squares)))
        power, axes = np.linalg.eigh(squares / np.outer(unit, unit))
        shares_seen = axes.T @ (weighted.T @ target / unit) / np.maximum(power - 1, 1e-9)
        shares = axes @ np.where(power > CLEAR, shares_seen, axes.T @ (unit * before)) / unit
    return shares
