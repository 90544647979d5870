"""The room behind a turntable, masked by evidence: it stays the same from stop to stop while the things turn.

Every exposure of a camera is averaged over cells, and cells are compared over the stops, against what noise
and unsteady light explain. A cell that varies no more than that is room, or as good as room, at all stops.
Of one that varies, the light that it has at the most stops is the room's, if these are many: things look
alike at few.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from calib.data.views import View
from calib.evidence import Evidence
from imaging.arrays import Array, Integers, Mask
from imaging.files import store
from imaging.files.photo import encode_png
from imaging.merge.linear_frame import LinearFrame, read_linear
from imaging.merge.masks import read_mask
from imaging.progress import Progress
from imaging.session.records import Rung, ShotRecord

RUNG = "turning_mask"
CELLS = 320
"""Cells across a picture, or fewer: as fine as borders of things need, and small enough for all stops."""
STEADY = 0.005
"""Relative error of the light from stop to stop that no common factor removes."""
EXCESS = 4.0
"""Variance over the stops, in units of what is explained, above which a cell turns: variation of twice its
standard error."""
FEWEST_STOPS = 4
EQUAL = 6.0
"""Squared difference of two stops, in units of what is explained, up to which a cell has the same light."""
ROOM = 0.25
"""Least share of the stops that show the room where it is kept apart from things that look alike at some."""
SPECK = 9
"""Cells of the smallest turning area; noise and hot photosites make smaller ones."""
LEAST, MOST = 0.002, 0.98
"""Shares of a picture that turn; outside of them nothing turned, or everything did: the camera was moved."""


def without_background(evidence: Evidence, progress: Progress) -> tuple[Evidence, tuple[Rung, ...]]:
    """Mask what does not turn in the shots of a turntable's session, which get the masks on record.

    Shots that came with masks keep these. A mask of an earlier run is used as long as all shots have it.

    Args:
        evidence: Views of the scene; others, and sessions without a turntable, stay as they are.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The evidence with masked shots, and a rung for each camera.

    Raises:
        InputError: A shot is missing or damaged.
        StorageError: The disk refuses.
    """
    if evidence.session.turntable() is None:
        return evidence, ()
    views: list[View] = []
    rungs: list[Rung] = []
    for name in dict.fromkeys(view.camera.name for view in evidence.views):
        of_camera = [view for view in evidence.views if view.camera.name == name]
        masked, rung = _masked(evidence, name, of_camera, progress)
        views += masked
        rungs.append(rung)
    return replace(evidence, views=views), tuple(rungs)


def _masked(
    evidence: Evidence, name: str, views: Sequence[View], progress: Progress
) -> tuple[Sequence[View], Rung]:
    session = evidence.session
    files = {view.id: f"masks/{view.id}.png" for view in views}
    there = {(shot.mask, files[view.id]) for view in views for shot in view.shots}
    if any(mask not in (None, file) for mask, file in there):
        return views, Rung(name=RUNG, taken=False, reason=f"the photographs of {name} came with masks")
    size = views[0].shots[0].height, views[0].shots[0].width
    if all(mask is not None for mask, _ in there):
        return views, _rung(name, [read_mask(session.folder / file, *size).mean() for file in files.values()])
    if len(views) < FEWEST_STOPS:
        reason = f"{name} has {len(views)} stops, and what turns shows in {FEWEST_STOPS} or more"
        return views, Rung(name=RUNG, taken=False, reason=reason)
    areas = turning_areas(evidence, views, progress)
    shares = [float(area.mean()) for area in areas]
    if not LEAST < np.mean(shares) < MOST:
        what = "nothing" if np.mean(shares) <= LEAST else "everything"
        reason = f"{what} in the pictures of {name} changes from stop to stop, so that nothing is masked"
        return views, Rung(name=RUNG, taken=False, reason=reason)
    masked = []
    for view, area in zip(views, areas, strict=True):
        path = session.folder / files[view.id]
        store.make_folder(path.parent)
        store.write_bytes(path, encode_png(np.where(area, 255, 0).astype(np.uint8)))
        known: dict[str, object] = {"mask": files[view.id], "mask_sha256": store.sha256(path)}
        masked.append(replace(view, shots=tuple(shot.model_copy(update=known) for shot in view.shots)))
    for shot in (shot for view in masked for shot in view.shots):
        session.append_shot(shot)
    return masked, _rung(name, shares)


def _rung(name: str, shares: Sequence[float]) -> Rung:
    reason = (
        f"{np.mean(shares):.0%} of the pictures of {name} turn; the rest stays the same over {len(shares)} "
        "stops and is masked in features and training"
    )
    return Rung(name=RUNG, taken=True, reason=reason)


@dataclass(frozen=True, eq=False)
class _Step:
    """One step of the bracket at the stops that have it, [N]: mean of each cell [N, h, w], the variance of it
    that noise and unsteady light explain, and which cells hold numbers."""

    stops: Integers
    mean: Array
    variance: Array
    known: Mask


def turning_areas(evidence: Evidence, views: Sequence[View], progress: Progress) -> list[Mask]:
    """Return where each view of one camera shows something that turns, bool [H, W]; errors as of reading."""
    first = views[0].shots[0]
    cell = _cell(first.width)
    read: dict[int, dict[int, tuple[Array, Array, Mask]]] = {}
    for stop, view in enumerate(views):
        progress(f"comparing the stops of {view.camera.name}", stop, len(views))
        for shot in view.shots:
            read.setdefault(shot.step, {})[stop] = _averaged(_read(evidence, view, shot), cell)
    progress(f"comparing the stops of {views[0].camera.name}", len(views), len(views))
    steps = [
        _steadied(np.array(list(cells)), *map(np.stack, zip(*cells.values(), strict=True)))
        for cells in read.values()
    ]
    squares, freedom = (np.sum(parts, axis=0) for parts in zip(*map(_variation, steps), strict=True))
    swept = _whole(squares > EXCESS * np.maximum(freedom, 1.0))
    areas = [_whole(swept & ~room) & swept for room in _rooms(steps, len(views))]
    return [_at_full_size(area, cell, first.height, first.width) for area in areas]


def _at_full_size(area: Mask, cell: int, height: int, width: int) -> Mask:
    wide = np.repeat(np.repeat(area, cell, axis=0), cell, axis=1)
    # Cells at the far border may be incomplete: they are as their neighbours.
    short = [(0, max(0, size - have)) for size, have in zip((height, width), wide.shape, strict=True)]
    return np.asarray(np.pad(wide, short, mode="edge")[:height, :width])


def _cell(width: int) -> int:
    """Side of a cell, px: tiles of Bayer and X-Trans mosaics both fit into 6 photosites, of Bayer into 2."""
    return 2 if width <= 2 * CELLS else 6 * max(1, round(width / (6 * CELLS)))


def _read(evidence: Evidence, view: View, shot: ShotRecord) -> LinearFrame:
    return read_linear(
        evidence.session.file(shot),
        view.camera.kind,
        evidence.light.scale[shot.file],
        evidence.light.responses[view.camera.name],
        view.sensors,
    )


def _averaged(frame: LinearFrame, cell: int) -> tuple[Array, Array, Mask]:
    """Mean signal of each whole cell [h, w], its variance by noise, and where all of it holds numbers."""
    signal = frame.signal.astype(np.float64)
    known: Mask = np.asarray(frame.valid & ~frame.saturated)
    noise = np.zeros_like(signal)
    if frame.noise is not None:
        noise = frame.noise.variance(signal).astype(np.float64)
    if signal.ndim == 3:
        signal, noise, known = signal.mean(axis=2), noise.mean(axis=2) / 3, np.asarray(known.all(axis=2))
    rows, columns = (size // cell for size in signal.shape)

    def cells(plane: Array) -> Array:
        whole = plane[: rows * cell, : columns * cell]
        return np.asarray(whole.reshape(rows, cell, columns, cell).mean(axis=(1, 3)))

    return cells(np.where(known, signal, 0.0)), cells(noise) / cell**2, cells(known.astype(np.float64)) == 1.0


def _steadied(stops: Integers, mean: Array, variance: Array, known: Mask) -> _Step:
    """The cells of a step without the common factors of light and shutter from stop to stop.

    These move nothing: most of a picture stands still.
    """
    middle = np.nanmedian(np.where(known, mean, np.nan)[:, known.any(axis=0)], axis=0)
    level = np.zeros(mean.shape[1:])
    level[known.any(axis=0)] = middle
    bright = known.all(axis=0)
    bright &= level > max(0.0, float(np.median(level[bright])) if bright.any() else 0.0)
    if bright.any():
        mean = mean / np.median(mean[:, bright] / level[bright], axis=1)[:, None, None]
    return _Step(stops, mean, variance + np.square(STEADY * level), known)


def _variation(step: _Step) -> tuple[Array, Array]:
    """Sum over the stops of squared deviations, in units of the explained variance, and its degrees of
    freedom, each [h, w]."""
    stops = step.known.sum(axis=0)
    middle = np.where(step.known, step.mean, 0.0).sum(axis=0) / np.maximum(stops, 1)
    squares = np.where(step.known, np.square(step.mean - middle) / step.variance, 0.0).sum(axis=0)
    return squares, np.maximum(stops - 1, 0)


def _rooms(steps: Sequence[_Step], stops: int) -> Mask:
    """Return where each stop has the light that most stops have, if these are many, bool [N, h, w]."""
    shape = steps[0].mean.shape[1:]
    most, rooms = np.zeros(shape, int), np.zeros((stops, *shape), bool)
    for stop in range(stops):
        same, compared = np.ones(rooms.shape, bool), np.zeros(stops, bool)
        for step in steps:
            for row in np.flatnonzero(step.stops == stop):
                # Saturated at both stops is no difference, and saturated at one of them is.
                both = step.known & step.known[row]
                explained = EQUAL * (step.variance + step.variance[row])
                same[step.stops] &= np.where(
                    both, np.square(step.mean - step.mean[row]) <= explained, step.known == step.known[row]
                )
                compared[step.stops] = True
        # Stops without a step in common are not known to be the same.
        same &= compared[:, None, None]
        count = same.sum(axis=0)
        better = count > most
        most[better], rooms[:, better] = count[better], same[:, better]
    return np.asarray(rooms & (most >= max(FEWEST_STOPS, ROOM * stops)))


def _whole(varies: Mask) -> Mask:
    """Close gaps of a cell, drop specks, and fill what is enclosed: what a thing hides at every stop, or what
    looks alike at every turn."""
    area = cv2.morphologyEx(varies.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    area = _larger(area, SPECK)
    # Still cells that no way through still cells leads out of the picture from.
    _, labels = cv2.connectedComponents(1 - area, connectivity=4)
    outside = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    enclosed = ~np.isin(labels, outside) & (area == 0)
    return np.asarray((area == 1) | enclosed)


def _larger(area: Mask, cells: int) -> Mask:
    """The connected parts of an area that have as many cells or more."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(area, connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= cells
    large[0] = False
    return np.asarray(large[labels].astype(np.uint8))
