"""Through what share of the points before the cameras views see light from far away, which decides on it.

    python -m bench.foreign.far_share [--quick] [--json] [--write] [--work FOLDER]

Path-traced scenes of `tests/foreign` with true poses and light: two yards before a sky, objects before a
light probe, a closed room; simulated scenes with their true calibration; a telephone's video of a fox before
wallpaper with its published poses, where RIG_DATA has it. --quick: the yards alone.
"""

import argparse
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import session as simulated
from imaging.arrays import Array
from imaging.colour.spaces import srgb_decode
from imaging.session.calibration import Response
from recon.data.dataset import Sensor, View
from recon.data.light import Images, radiance_image
from recon.data.load import load
from recon.data.shot import HeldPlanes, Shot
from recon.decide.steps.far_field import ROWS, SUGGESTED, SURE
from recon.splat import SplatCamera
from recon.start.far_light import far_light, looked_through
from recon.start.initialisation import Start, colours_at
from recon.start.plane_sweep import plane_sweep, sample
from tests.foreign import subjects, yards

WIDTH = 80
SIMULATED = ("demo",)
SPARSE, SWEPT = 400, 2500
LINEAR = Response(kind="linear", evidence="true light")


def views_of(light: np.ndarray, poses: Array, focal: float) -> tuple[tuple[View, ...], Images]:
    """Views of true light [V, H, W, 3], averaged to `WIDTH` where they are wider."""
    step = max(1, light.shape[2] // WIDTH)
    views, images = [], []
    for number, (picture, pose) in enumerate(zip(light, poses, strict=True)):
        height, width = picture.shape[0] // step, picture.shape[1] // step
        tiles = picture[: height * step, : width * step].reshape(height, step, width, step, 3)
        downsampled = np.ascontiguousarray(tiles.mean((1, 3)), np.float32)
        none = np.zeros(downsampled.shape, bool)
        lens = SplatCamera(pose, focal / step, focal / step, width / 2, height / 2, width, height)
        sensor = Sensor("hdr", None, np.eye(3), np.ones((height, width), np.float32), LINEAR)
        views.append(
            View("c", number, lens, sensor, (Shot("", 1.0, HeldPlanes(downsampled, none, none, ~none)),))
        )
        images.append((downsampled, np.ones((height, width), bool)))
    return tuple(views), images


def fox(folder: Path) -> tuple[np.ndarray, Array, float]:
    """Light, poses and focal length, px, of the video's frames, 108 px wide, by the published poses."""
    published = json.loads((folder / "transforms.json").read_text())
    light, poses = [], []
    for frame in published["frames"]:
        path = folder / frame["file_path"]
        if path.is_file():
            picture = Image.open(path).resize((108, 192), Image.Resampling.BOX)
            light.append(srgb_decode(np.asarray(picture, np.float32) / 255))
            placed = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
            poses.append(np.linalg.inv(placed))
    return np.stack(light), np.stack(poses), published["fl_x"] * 108 / published["w"]


def cases(options: argparse.Namespace) -> Iterator[tuple[str, float]]:
    """Names of scenes and their shares."""
    made = [yards.low_sun(), yards.high_sun()]
    if not options.quick:
        made += [
            subjects.objects(views=28, width=160, samples=9, traced=64),
            subjects.room(views=18, width=160, samples=9, traced=64),
        ]
    for scene in made:
        views, images = views_of(scene.light(), scene.poses, scene.focal)
        yield f"{scene.name}, path-traced", share(views, images, scene.surface_points(SPARSE))
    if options.quick:
        return
    for name in SIMULATED:
        dataset = load(simulated(options.work, name, 0, "truth"), max_width=2 * WIDTH)
        images = [radiance_image(view) for view in dataset.train]
        points = dataset.points().xyz
        yield f"{name}, simulated", share(dataset.train, images, points[:: max(1, len(points) // SPARSE)])
    real = Path(os.environ.get("RIG_DATA", "")) / "fox"
    if real.is_dir():
        light, poses, focal = fox(real)
        views, images = views_of(light, poses, focal)
        yield "fox, photographs", share(views, images, None)


def share(views: tuple[View, ...], images: Images, points: Array | None) -> float:
    """Share of swept points, as in `recon.decide.steps.far_field`; points: sparse ones [P, 3], if any."""
    maps = plane_sweep(views, images, points)
    xyz = sample(maps, SWEPT, np.random.default_rng(0))
    dataset = argparse.Namespace(train=views, session=Path())
    rgb, visible = colours_at(dataset, images, xyz)  # type: ignore[arg-type]
    start = Start(xyz[visible], rgb[visible], 0)

    def units(light: torch.Tensor) -> torch.Tensor:
        return light

    far = far_light(views, images, units, ROWS)
    return float(looked_through(start, views, images, far, units).mean())


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Points through which views see light from far away",
        "",
        f"`python -m bench.foreign.far_share --write`: {SWEPT:,} points of a plane sweep a scene, {WIDTH} px "
        f"wide or 108. {words(result['machine'])}.",
        "",
        "The share of them at which most views show the light that others show in the same direction, and "
        f"rather that than the light of the point. Below {100 * SUGGESTED:g} % there is no far field; else a "
        f"trial decides, and where none can be made there is one above {100 * SURE:g} %.",
        "",
        "| scene | share, % | |",
        "|---|---|---|",
    ]
    for row in result["rows"]:
        verdict = "refused" if row["share"] < SUGGESTED else "tried"
        lines.append(f"| {row['scene']} | {100 * row['share']:.1f} | {verdict} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    rows = [{"scene": name, "share": share} for name, share in cases(options)]
    result = {"machine": machine(), "rows": rows}
    deliver(options, "far_share", result, report(result))


if __name__ == "__main__":
    main()
