"""Albedo and irradiance of `rig export --albedo` against path-traced scenes whose own are known.

    python -m bench.output.albedo [--quick] [--json] [--write] [--work FOLDER] [--scenes room,...]
        [--quality draft]

A room with lamps, yards before the sun and objects before a light probe (`tests/foreign`), in RAW
brackets with given poses; what is matte in the pictures of all views. A pixel has a value where Gaussians
with one make up half of it or more. --quick: a third of the views, half as wide, 100 iterations.
"""

import argparse
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.support.record import WORK, arguments, deliver, machine, words
from recon.albedo.estimate import Albedo, albedo_of
from recon.result.scene import Scene, open_scene
from recon.scene.gaussians import drawn_values
from rig.__main__ import main as rig
from tests.foreign import subjects, yards
from tests.foreign.folder import Body, photograph, tell_poses
from tests.foreign.lit import LitScene
from tests.foreign.matte import matte

LAMPS = ((1 / 4000, 1 / 250, 1 / 15, 1.0),)
SUN = ((1 / 8000, 1 / 500, 1 / 30, 1 / 2, 8.0),)
PROBE = ((1 / 125, 1 / 8, 2.0),)
GUESS = 0.5


@dataclass(frozen=True)
class Case:
    """A subject, how it is photographed, and whether there is light from far away."""

    title: str
    make: Callable[..., LitScene]
    body: Body
    times: tuple[tuple[float, ...], ...]
    far: bool = True


CASES = {
    "room": Case("room with lamps", subjects.room, Body(14, seed=1), LAMPS, far=False),
    "low-sun": Case("yard, low sun", yards.low_sun, Body(14, seed=5, seconds=4.0), SUN),
    "high-sun": Case("yard, high sun", yards.high_sun, Body(14, seed=5, seconds=4.0), SUN),
    "objects": Case(
        "objects before a light probe", subjects.objects, Body(12, well=9_000.0, black=256, seed=3), PROBE
    ),
}


def subject(name: str, quick: bool) -> LitScene:
    """The scene of a case."""
    views, width, samples, traced = (8, 64, 4, 8) if quick else (16, 96, 4, 24)
    return CASES[name].make(views=views, width=width, samples=samples, traced=traced)


def trained(name: str, scene: LitScene, folder: Path, quality: str, quick: bool) -> Path:
    """The reconstruction of a case, made where it is missing."""
    case, session = CASES[name], folder / "S"
    made = session / "reconstructions" / "scene"
    if (made / "model.json").exists():
        return made
    shutil.rmtree(folder, ignore_errors=True)
    shots = photograph(folder / "photos", scene.light(), case.body, case.times)
    tell_poses(shots, scene.poses, scene.focal, (scene.width, scene.height), scene.surface_points())
    rig(["import", str(shots.folder), str(session)])
    rig(["calibrate", str(session), "--only", "response"])
    given = ["--set", f"environment={int(case.far)}", *(["--set", "iterations=100"] if quick else [])]
    rig(["reconstruct", str(session), "--quality", quality, "--name", "scene", *given])
    return made


def drawn(scene: Scene, albedo: Albedo) -> dict[str, np.ndarray]:
    """Pictures of all views: albedo, irradiance, sigma, light; NaN where Gaussians without values prevail."""
    known = torch.from_numpy(albedo.known)
    values = np.column_stack([albedo.albedo, albedo.irradiance, albedo.sigma])
    layers = torch.cat([torch.from_numpy(np.nan_to_num(values)).float(), known[:, None].float()], 1)
    pictures: dict[str, list[np.ndarray]] = {"albedo": [], "irradiance": [], "sigma": [], "light": []}
    for view in sorted(scene.views, key=lambda view: view.frame):
        camera = scene.record.world.camera(view.splat_camera)
        with torch.no_grad():
            shapes = scene.renderer.shapes(scene.gaussians, camera)
            image = drawn_values(shapes, layers, camera, scene.renderer.limits).image.double().numpy()
        share = image[..., 7:]
        image = np.where(share >= 0.5, image[..., :7] / np.maximum(share, 1e-6), np.nan)
        pictures["albedo"].append(image[..., :3])
        pictures["irradiance"].append(image[..., 3:6])
        pictures["sigma"].append(image[..., 6])
        pictures["light"].append(scene.render(view))
    return {name: np.stack(parts) for name, parts in pictures.items()}


def averaged(image: np.ndarray, width: int) -> np.ndarray:
    """Pictures [V, H, W, C] at another width, by means of tiles; NaN where any of a tile is."""
    step = image.shape[2] // width
    views, height = image.shape[0], image.shape[1] // step
    tiles = image[:, : height * step, : width * step].reshape(views, height, step, width, step, -1)
    return np.asarray(tiles.mean((2, 4)))


def judged(scene: Scene, subject: LitScene, albedo: Albedo) -> dict[str, Any]:
    """Figures of a scene."""
    ours = drawn(scene, albedo)
    frames = sorted(view.frame for view in scene.views)
    width = ours["light"].shape[2]
    truth = matte(subject)
    true = averaged(truth.albedo[frames], width).mean(-1)
    arriving = averaged(truth.irradiance[frames], width).mean(-1)
    light = averaged(subject.light()[frames], width).mean(-1)
    there = np.isfinite(true)
    known = there & np.isfinite(ours["sigma"])
    figures: dict[str, Any] = {
        "gaussians": float(albedo.known.mean()),
        "known": float(known.sum() / there.sum()),
    }
    figures["guess"] = float(np.median(np.abs(GUESS - true[there])))
    shiny = np.isin(subject.shown()[frames], [subject.parts.index(name) for name in subject.shapes])
    if shiny.any():
        shown = averaged(shiny[..., None].astype(float), width)[..., 0] == 1
        figures["known_shiny"] = float(np.isfinite(ours["sigma"])[shown].mean())
    if known.sum() < 20:
        return figures
    scale = np.median(light[there] / ours["light"].mean(-1)[there].clip(1e-12))
    error = ours["albedo"].mean(-1)[known] - true[known]
    stops = np.log2(scale * ours["irradiance"].mean(-1)[known] / arriving[known])
    figures |= {
        "error": float(np.median(np.abs(error))),
        "bias": float(np.median(error)),
        "error_95": float(np.quantile(np.abs(error), 0.95)),
        "guess_known": float(np.median(np.abs(GUESS - true[known]))),
        "constant_known": float(np.median(np.abs(np.median(true[known]) - true[known]))),
        "stops": float(np.median(np.abs(stops))),
        "stops_bias": float(np.median(stops)),
        "sigma": float(np.median(ours["sigma"][known])),
        "covered": float(np.mean(np.abs(error) <= ours["sigma"][known])),
        "covered_twice": float(np.mean(np.abs(error) <= 2 * ours["sigma"][known])),
    }
    return figures


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each scene."""
    rows = []
    for name in options.scenes.split(","):
        scene = subject(name, options.quick)
        folder = options.work / f"albedo-{name}-{options.quality}{'-quick' * options.quick}"
        opened = open_scene(trained(name, scene, folder, options.quality, options.quick))
        began = time.process_time()
        albedo = albedo_of(opened)
        seconds = time.process_time() - began
        row = {"scene": name, "seconds": seconds, "count": len(opened.gaussians)} | judged(
            opened, scene, albedo
        )
        rows.append(row)
    return {"machine": machine(), "quality": options.quality, "rows": rows}


COLUMNS = (
    ("Gaussians", "count", "{:,.0f}"),
    ("of pixels known", "known", "{:.0%}"),
    ("of metal, glass, lamps", "known_shiny", "{:.0%}"),
    ("albedo off", "error", "{:.3f}"),
    ("0.5 there", "guess_known", "{:.3f}"),
    ("0.5 everywhere", "guess", "{:.3f}"),
    ("by sign", "bias", "{:+.3f}"),
    ("off in 5 %", "error_95", "{:.3f}"),
    ("irradiance off, stops", "stops", "{:.2f}"),
    ("by sign, stops", "stops_bias", "{:+.2f}"),
    ("stated error", "sigma", "{:.3f}"),
    ("within it", "covered", "{:.0%}"),
    ("within twice", "covered_twice", "{:.0%}"),
    ("processor s", "seconds", "{:.0f}"),
)


def report(result: dict[str, Any]) -> str:
    """Markdown."""
    lines = [
        "# Albedo and irradiance",
        "",
        "`python -m bench.output.albedo --write`: path-traced scenes in RAW brackets, 16 views of 96 px, "
        f"given poses, preset {result['quality']}, light from far away where there is some. Medians over the "
        "matte pixels of all views that have a value, of the mean of their channels; albedo is 0 to 1. "
        f"{words(result['machine'])}.",
        "",
        "| scene | " + " | ".join(title for title, _, _ in COLUMNS) + " |",
        "|---" * (len(COLUMNS) + 1) + "|",
    ]
    for row in result["rows"]:
        cells = ["-" if row.get(key) is None else form.format(row[key]) for _, key, form in COLUMNS]
        lines.append(f"| {CASES[row['scene']].title} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK, help="keeps sessions and scenes")
    parser.add_argument("--scenes", default="room,high-sun,objects", help="comma-separated")
    parser.add_argument("--quality", default="draft", choices=("draft", "standard", "best"))
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "albedo", result, report(result))


if __name__ == "__main__":
    main()
