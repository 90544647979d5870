"""Layers of data of trained scenes, depth, normals and trust, against where the simulator's surfaces are.

    python -m bench.recon.parts.layers [--sets demo] [--quick] [--json] [--write] [--seeds 1] [--work FOLDER]

The demo and the gallery, poses and exposures given, trained with the preset draft; held-out views. True depth
is cast along the ray of each pixel, true normals are differences of true places, and the true trust is how
many training views see the place of a pixel, no nearer surface being in between, and measure the light that
is drawn there. The mean depth, by which 3DGS is usually measured, stands beside the median that is drawn, and
normals from differences of the depth beside those of the Gaussians.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import session
from drivers.sim.rigs import simulate
from drivers.sim.scene.scene import Scene as Subject
from imaging.arrays import Array, Floats
from imaging.session.session import Session
from recon.data.geometry import inside, project, rays
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.data_layers import DataLayers
from recon.result.model import SceneView
from recon.result.scene import Scene, open_scene
from recon.scene.gaussians import drawn_values
from recon.splat import SplatCamera

SETS = "demo,gallery"
NEARER = 0.98
"""Ratio of the distance of a place below which a nearer surface hides it."""


def places(subject: Subject, camera: SplatCamera) -> tuple[Array, Array]:
    """True depth [H, W] along the axis, and the places [H, W, 3] that pixels see."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    ahead = rays(camera, np.stack([x, y], -1))
    motion = camera.cam_from_world
    directions = ahead @ motion[:3, :3]
    lengths = np.linalg.norm(directions, axis=-1, keepdims=True)
    origin = -motion[:3, :3].T @ motion[:3, 3]
    flat = (directions / lengths).reshape(-1, 3)
    away = subject.depth(np.tile(origin, (len(flat), 1)), flat).reshape(*lengths.shape[:2], 1)
    return (away / lengths)[..., 0], origin + away / lengths * directions


def normals(xyz: Array, centre: Array) -> Array:
    """Normals of the surface through places [H, W, 3], towards a centre."""
    crossed = np.cross(np.gradient(xyz, axis=1), np.gradient(xyz, axis=0))
    crossed /= np.maximum(np.linalg.norm(crossed, axis=-1, keepdims=True), 1e-30)
    return np.asarray(crossed * -np.sign(((xyz - centre) * crossed).sum(-1, keepdims=True)))


def mean_depth(scene: Scene, camera: SplatCamera) -> Array:
    """The depth [H, W] of the Gaussians of a pixel by what they add to it."""
    placed = scene.record.world.camera(camera)
    with torch.no_grad():
        shapes = scene.renderer.shapes(scene.gaussians, placed)
        motion = torch.from_numpy(placed.cam_from_world).float()
        depth = shapes.means @ motion[2, :3] + motion[2, 3]
        render = drawn_values(shapes, depth[:, None], placed, scene.renderer.limits)
    return np.asarray((render.image[..., 0] / render.alpha).numpy() * scene.record.world.unit)


def true_trust(scene: Scene, view: SceneView, xyz: Array, depths: dict[str, Array]) -> Array:
    """Return how many training views see places [H, W, 3] and measure the light drawn there."""
    light = scene.render(view)
    counts = np.zeros(xyz.shape[:2])
    for other in scene.views:
        if other.use != "training":
            continue
        pixels, depth = project(other.splat_camera, xyz)
        visible = inside(other.splat_camera, pixels, depth)
        column, row = np.moveaxis(
            pixels.clip(0, [other.lens.width - 1, other.lens.height - 1]).astype(int), -1, 0
        )
        visible &= NEARER * depth < depths[other.name][row, column]
        measured = np.zeros_like(visible)
        for shot in other.shots:
            least, most = shot.measures or (-np.inf, np.inf)
            measured |= ((light > least) & (light < most)).any(-1)
        counts += visible & measured
    return counts


def angle(a: Floats, b: Array) -> Array:
    """Degrees between unit vectors."""
    return np.asarray(np.degrees(np.arccos(np.clip((a * b).sum(-1), -1, 1))))


def measured(name: str, seed: int, options: argparse.Namespace) -> list[dict[str, float]]:
    """One row a held-out view."""
    folder = session(options.work, name, seed, "truth")
    scene = open_scene(trained(folder))
    subject = simulate(Session.open(folder).record.origin.removeprefix("sim:")).scene
    layers = DataLayers(scene)
    depths = {view.name: places(subject, view.splat_camera)[0] for view in scene.views}
    rows = []
    for view in scene.views:
        if view.use == "training":
            continue
        camera = view.splat_camera
        depth, xyz = places(subject, camera)
        centre = -camera.cam_from_world[:3, :3].T @ camera.cam_from_world[:3, 3]
        median, mean = layers.depth(camera), mean_depth(scene, camera)
        surface = np.isfinite(median)
        right = normals(xyz, centre)
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        lifted = rays(camera, np.stack([x, y], -1)) * mean[..., None] @ camera.cam_from_world[:3, :3] + centre
        row: dict[str, float] = {"known": float(surface.mean())}
        for what, estimate in (("median", median), ("mean", mean)):
            off = np.abs(estimate / depth - 1)[surface]
            row |= {f"{what} p50": float(np.median(off)), f"{what} p99": float(np.percentile(off, 99))}
        row["normal"] = float(np.median(angle(layers.normal(camera), right)))
        row["normal of depth"] = float(np.median(angle(normals(lifted, centre), right)))
        trust, truth = layers.trust(camera), true_trust(scene, view, xyz, depths)
        row["trust"], row["true trust"] = float(trust.mean()), float(truth.mean())
        row["trust off"] = float(np.abs(trust - truth).mean())
        rows.append(row)
    return rows


def trained(folder: Path) -> Path:
    """The scene of a session, trained unless it is there."""
    there = sorted((folder / "reconstructions").glob("*/model.json"))
    return there[0].parent if there else Path(reconstruct(folder, TrainingRequest(quality="draft")))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    rows = []
    for name in ("toy",) if options.quick else options.sets.split(","):
        figures = [row for seed in range(options.seeds) for row in measured(name, seed, options)]
        rows.append({"set": name, "views": len(figures)} | {key: mean_of(figures, key) for key in figures[0]})
    return {"machine": machine(), "sets": options.sets, "seeds": options.seeds, "rows": rows}


def mean_of(rows: list[dict[str, float]], key: str) -> float:
    return float(np.mean([row[key] for row in rows]))


def report(result: dict[str, Any]) -> str:
    columns = ("set", "views", "surface", "median", "mean", "normals", "of depth", "trust", "true", "off by")
    lines = [
        "# Depth, normals and trust of trained scenes",
        "",
        f"`python -m bench.recon.parts.layers --sets {result['sets']} --write`: draft, "
        f"{result['seeds']} seed(s), held-out views, pixels that the median calls a surface. By how "
        "much of itself the median depth, and "
        "the mean, is off: median and 99th percentile over pixels. Degrees by which normals are off, of the "
        "Gaussians and of the mean depth, median. Views that trust counts, as many as there are in truth, "
        "and by how many a pixel is off, means. "
        f"{words(result['machine'])}.",
        "",
        f"| {' | '.join(columns)} |",
        "|---" * len(columns) + "|",
    ]
    for row in result["rows"]:
        cells = [row["set"], row["views"], f"{100 * row['known']:.1f} %"]
        for what in ("median", "mean"):
            cells.append(f"{100 * row[f'{what} p50']:.2f}, {100 * row[f'{what} p99']:.1f} %")
        names = ("normal", "normal of depth", "trust", "true trust", "trust off")
        lines.append(f"| {' | '.join(map(str, [*cells, *(f'{row[name]:.1f}' for name in names)]))} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", default=SETS)
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "layers", result, report(result))


if __name__ == "__main__":
    main()
