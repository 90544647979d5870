"""The rig and the scene's points from above, as inline SVG."""

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup, escape

from imaging.arrays import Array
from imaging.session.view_id import ViewId
from rig.report.charts.chart import COLOURS

WIDTH, LOWEST, TALLEST, MARGIN = 640, 200, 520, 26
MOST_POINTS = 2500


def ground(poses: Sequence[Array]) -> Array:
    """Axes of the view from above, float64 [2, 3]: to the right, and away from the cameras.

    "Away" is where the cameras on the whole look, levelled. poses: cam_from_world, [4, 4] each.
    """
    up = _up(poses)
    look = np.mean([pose[2, :3] for pose in poses], axis=0)
    away = look - up * (look @ up)
    if np.linalg.norm(away) < 1e-6:
        # They look in all directions, or straight down: any level axis will do.
        away = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    away = away / np.linalg.norm(away)
    return np.stack([np.cross(away, up), away])


def _up(poses: Sequence[Array]) -> Array:
    """The world's vertical: at right angles to every camera's horizontal.

    Photographers tilt cameras but seldom roll them. Where all look the same way, or are rolled, the
    mean of what the cameras hold up has to do.
    """
    held = -np.mean([pose[1, :3] for pose in poses], axis=0)
    if np.linalg.norm(held) < 1e-6:
        held = np.array([0.0, -1.0, 0.0])
    _, spread, axes = np.linalg.svd(np.array([pose[0, :3] for pose in poses]), full_matrices=True)
    spread = np.pad(spread, (0, 3 - len(spread)))
    level = spread[1] > 0.1 * spread[0] and spread[2] < 0.3 * spread[1]
    up = axes[2] * np.sign(axes[2] @ held) if level and abs(axes[2] @ held) > 1e-6 else held
    return np.asarray(up / np.linalg.norm(up))


def top_view(poses: Mapping[ViewId, Array], points: Array, title: str) -> Markup:
    """Cameras as small wedges that point where they look, coloured by camera; scene points as dots.

    poses: cam_from_world [4, 4]. points: float64 [P, 3].
    Points far outside are cut off, since a few stray ones would shrink everything else.
    """
    axes = ground(list(poses.values()))
    centres = {view: axes @ (-pose[:3, :3].T @ pose[:3, 3]) for view, pose in poses.items()}
    looks = {view: axes @ pose[2, :3] for view, pose in poses.items()}
    rig = np.array(list(centres.values()))
    cloud = points @ axes.T if len(points) else np.zeros((0, 2))
    low, high = rig.min(0), rig.max(0)
    if len(cloud):
        low = np.minimum(low, np.percentile(cloud, 2, axis=0))
        high = np.maximum(high, np.percentile(cloud, 98, axis=0))
    span = np.maximum(high - low, 1e-9)
    factor = min((WIDTH - 2 * MARGIN) / span[0], (TALLEST - 2 * MARGIN) / span[1])
    middle = (low + high) / 2
    height = max(float(span[1] * factor) + 2 * MARGIN, LOWEST)

    def place(spot: Array) -> Array:
        flat = (spot - middle) * factor
        return np.stack([WIDTH / 2 + flat[..., 0], height / 2 - flat[..., 1]], axis=-1)

    shown = cloud[((cloud >= low) & (cloud <= high)).all(1)] if len(cloud) else cloud
    shown = shown[:: max(1, -(-len(shown) // MOST_POINTS))]
    parts = [
        f'<svg class="chart" viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-label="{escape(title)}">',
        f"<title>{escape(title)}</title>",
        '<path class="cloud" d="' + "".join(f"M{x:.1f} {y:.1f}h0" for x, y in place(shown)) + '"/>',
    ]
    names = sorted({view.camera for view in poses})
    for view, centre in sorted(centres.items()):
        colour = names.index(view.camera) % COLOURS
        parts.append(_wedge(place(centre), looks[view], colour, str(view)))
    parts.append("</svg>")
    keys = "".join(
        f'<li><span class="key s{i % COLOURS}"></span>{escape(name)}</li>' for i, name in enumerate(names)
    )
    return Markup("".join(parts) + (f'<ul class="legend">{keys}</ul>' if len(names) <= 24 else ""))


def _wedge(at: Array, look: Array, colour: int, label: str) -> str:
    """A camera: a triangle that opens where it looks; shorter the steeper it looks up or down."""
    forward = np.array([look[0], -look[1]]) * 22.0
    side = np.array([-forward[1], forward[0]]) * 0.42
    left, right = at + forward + side, at + forward - side
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in (at, left, right))
    return (
        f'<g><title>{escape(label)}</title><polygon class="camera s{colour}" points="{corners}"/>'
        f'<circle class="eye s{colour}" cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="3"/></g>'
    )
