"""The rig and the scene as a turntable: drawn from all around, turned by the page's style sheet alone.

The page runs no script, so that it may be opened anywhere. Radio buttons choose which drawing is shown;
the arrow keys turn them.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

from imaging.arrays import Array
from imaging.optics.lens import Lens
from imaging.session.view_id import ViewId
from rig.report.charts.chart import COLOURS, nice_step
from rig.report.charts.poses.topview import ground

STEPS, FIRST = 12, 1
"""Directions that the rig is drawn from (the style sheet shows as many), and the one that is shown first."""
ELEVATION = math.radians(28)
WIDTH, HEIGHT, MARGIN = 1000, 460, 30
MOST_POINTS, MOST_VIEWS = 1000, 240
NO_BOARDS: Mapping[int, Array] = {}
MOST_LABELLED = 60
"""Views up to which each says its name when it is pointed at."""


@dataclass(frozen=True)
class _Rig:
    """Shapes that are drawn, in axes right, away, up: dots [P, 3], boards by frame, lines that join cameras,
    frusta by view; and the colour of each camera.
    """

    cloud: Array
    boards: Mapping[int, Array]
    joined: list[Array]
    frusta: Mapping[ViewId, Array]
    colours: Mapping[str, int]


@dataclass(frozen=True)
class _Facing:
    """A direction that the rig is drawn from: its number, the projection [2, 3] and the middle, both px."""

    turn: int
    flat: Array
    middle: Array

    def place(self, spots: Array) -> Array:
        """Pixels [N, 2] of spots [N, 3]."""
        return np.asarray(spots @ self.flat.T - self.middle + (WIDTH / 2, HEIGHT / 2))


def turntable(
    poses: Mapping[ViewId, Array],
    lenses: Mapping[str, Lens],
    points: Array,
    *,
    metric: bool,
    boards: Mapping[int, Array] = NO_BOARDS,
    group: str = "turn",
) -> Markup:
    """Cameras as frusta by colour, joined where they belong to one frame; scene points as dots.

    Args:
        poses: cam_from_world [4, 4] of each view.
        lenses: By camera; a camera without one gets a frustum of a usual angle.
        points: float64 [P, 3], world; those that are not finite are left out.
        metric: True if lengths are metres.
        boards: The corners of a board at each frame, in order around it, world, float64 [4, 3].
        group: Of the buttons, another for each turntable of a page.

    Returns:
        Drawings from `STEPS` directions, with the buttons that choose among them, and a legend of the
        cameras.
    """
    axes = ground(list(poses.values()))
    axes = np.stack([*axes, np.cross(axes[0], axes[1])])  # right, away, up
    step = max(1, -(-len(poses) // MOST_VIEWS))
    shown = dict(sorted(poses.items())[::step])
    centres = np.array([-pose[:3, :3].T @ pose[:3, 3] for pose in shown.values()]) @ axes.T
    shapes = {frame: corners @ axes.T for frame, corners in boards.items()}
    solid = np.concatenate([centres, *shapes.values()])
    cloud = points[np.isfinite(points).all(1)] @ axes.T if len(points) else np.zeros((0, 3))
    if len(cloud):
        cloud = _near(cloud, solid)
    views = [_flat(turn) for turn in range(STEPS)]
    spots = [np.concatenate([solid, cloud]) @ view.T for view in views]
    reach = np.maximum(np.max([np.ptp(group, axis=0) for group in spots], axis=0), 1e-9)
    factor = min((WIDTH - 2 * MARGIN) / reach[0], (HEIGHT - 2 * MARGIN) / reach[1])
    # Many small frusta show more than many that cover each other.
    depth = 36.0 * min(1.0, math.sqrt(40 / len(shown))) / factor
    frusta = {view: _frustum(pose, lenses.get(view.camera), depth) @ axes.T for view, pose in shown.items()}
    names = sorted({view.camera for view in poses})
    colours = {name: index % COLOURS for index, name in enumerate(names)}
    rig = _Rig(cloud, shapes, _joined(shown, centres), frusta, colours)
    drawings = []
    for turn, (view, there) in enumerate(zip(views, spots, strict=True)):
        middle = (there.min(0) + there.max(0)) / 2 * factor * (1.0, -1.0)
        facing = _Facing(turn, factor * view * ((1.0,), (-1.0,)), middle)
        drawings.append(_drawing(rig, facing, _scale(factor, metric)))
    inputs = "".join(
        f'<input type="radio" name="{group}" aria-label="Turned by {round(360 * turn / STEPS)} degrees"'
        f"{' checked' if turn == FIRST else ''}>"
        for turn in range(STEPS)
    )
    keys = "".join(
        f'<li><span class="key s{colour}"></span>{escape(name)}</li>' for name, colour in colours.items()
    )
    legend = f'<ul class="legend">{keys}</ul>' if len(names) <= COLOURS else ""
    return Markup(
        f'<div class="turn" role="radiogroup" aria-label="Direction that the rig is seen from">'
        f'<span class="soft">Seen from:</span>{inputs}{"".join(drawings)}</div>{legend}'
    )


def _flat(turn: int) -> Array:
    """Axes of the drawing, to the right and up the page, in (right, away, up), float64 [2, 3]."""
    angle = 2 * math.pi * turn / STEPS
    right, back = (math.cos(angle), math.sin(angle), 0.0), (-math.sin(angle), math.cos(angle), 0.0)
    upward = math.sin(ELEVATION) * np.array(back) + np.array([0.0, 0.0, math.cos(ELEVATION)])
    return np.stack([np.array(right), upward])


def _frustum(pose: Array, lens: Lens | None, depth: float) -> Array:
    """Eye and the four corners of the image `depth` away, world, float64 [5, 3]."""
    wide, high = (lens.width / 2 / lens.fx, lens.height / 2 / lens.fy) if lens else (0.5, 0.375)
    shrink = min(1.0, 0.8 / max(wide, high))  # a fisheye would cover the page
    corners = np.array([[-wide, -high, 1], [wide, -high, 1], [wide, high, 1], [-wide, high, 1]])
    rays = np.concatenate([np.zeros((1, 3)), corners * (1, 1, 1) * depth * shrink])
    return np.asarray((rays - pose[:3, 3]) @ pose[:3, :3])


def _near(cloud: Array, solid: Array) -> Array:
    """Some of the points [P, 3] near cameras and boards: a few stray ones would shrink everything else."""
    low = np.minimum(solid.min(0), np.percentile(cloud, 3, axis=0))
    high = np.maximum(solid.max(0), np.percentile(cloud, 97, axis=0))
    cloud = cloud[((cloud >= low) & (cloud <= high)).all(1)]
    return cloud[:: max(1, -(-len(cloud) // MOST_POINTS))]


def _joined(views: Iterable[ViewId], centres: Array) -> list[Array]:
    """The cameras of each frame in order, where a frame has several."""
    frames: dict[int, list[int]] = {}
    for index, view in enumerate(views):
        frames.setdefault(view.frame, []).append(index)
    return [centres[members] for members in frames.values() if len(members) > 1]


def _drawing(rig: _Rig, facing: _Facing, scale: str) -> str:
    """The picture from one direction; scale: its ruler."""
    place = facing.place
    parts = [
        f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="Rig and scene, turned by {round(360 * facing.turn / STEPS)} degrees">',
        '<path class="cloud" d="' + "".join(f"M{x:.0f} {y:.0f}h0" for x, y in place(rig.cloud)) + '"/>',
    ]
    for frame, corners in rig.boards.items():
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in place(corners))
        parts.append(f'<g><title>board, frame {frame}</title><path class="board" d="M{path}Z"/></g>')
    for line in rig.joined:
        path = "L".join(f"{x:.1f} {y:.1f}" for x, y in place(line))
        parts.append(f'<path class="bar-of" d="M{path}"/>')
    for view, corners in rig.frusta.items():
        title = f"<title>{escape(str(view))}</title>" if len(rig.frusta) <= MOST_LABELLED else ""
        parts.append(_drawn(place(corners), rig.colours[view.camera], title))
    if 1 < len(rig.colours) <= 12:
        parts += _names(rig, facing)
    return "".join([*parts, scale]) + "</svg>"


def _names(rig: _Rig, facing: _Facing) -> Iterable[str]:
    """The name of each camera, at its frustum of the first frame."""
    first = min(view.frame for view in rig.frusta)
    for view, corners in rig.frusta.items():
        if view.frame == first:
            x, y = facing.place(corners[:1])[0]
            yield (
                f'<text class="name s{rig.colours[view.camera]}" x="{x + 6:.0f}" y="{y - 6:.0f}">'
                f"{escape(view.camera)}</text>"
            )


def _drawn(spots: Array, colour: int, title: str) -> str:
    (x, y), *corners = spots.tolist()
    around = "L".join(f"{u:.1f} {v:.1f}" for u, v in corners)
    edges = "".join(f"M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}" for u, v in corners)
    return f'<g>{title}<path class="camera s{colour}" d="M{around}Z{edges}"/></g>'


def _scale(factor: float, metric: bool) -> str:
    if not metric:
        return f'<text x="{MARGIN}" y="{HEIGHT - 8}">lengths are relative</text>'
    length = nice_step(60 / factor)
    end = MARGIN + length * factor
    text = f"{length:g} m" if length >= 1 else f"{100 * length:g} cm"
    return (
        f'<path class="ruler" d="M{MARGIN} {HEIGHT - 24}v6H{end:.1f}v-6"/>'
        f'<text x="{MARGIN}" y="{HEIGHT - 4}">{text}</text>'
    )
