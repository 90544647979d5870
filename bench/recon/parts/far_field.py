"""Environment behind the Gaussians: its gain before a far background.

    python -m bench.recon.parts.far_field [--quick] [--json] [--write] [--seeds 2] [--work FOLDER]

Objects before a light probe, path-traced by Mitsuba and seen all around (`tests/foreign/scenes.py`), as RAW
brackets with true poses and no points, trained by the preset draft with and without. Where it is taken is in
`bench/foreign/far_share.py`. --quick: one seed of 40 iterations.
"""

import argparse
import os
import shutil
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from bench.support.record import arguments, deliver, machine, words
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.sensor.noise import SensorNoise
from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response, ViewCalibration
from imaging.session.session import Session
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.scene import open_scene
from tests.foreign.photographs import GAIN, READ, probe, session
from tests.foreign.scenes import Scene, box, floor, moved, ring, spots, surface

SIGNAL = 15.0
"""Signal of the photographs for light 1 in 1 s."""
MIDDLE = 0.02
"""Median light of the views."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def scene() -> Scene:
    """A crate, each side its own, beside a ball of gold on a square of ground, in Grace Cathedral."""
    far = probe(Path(os.environ["RIG_DATA"]) / "radiance" / "Grace_Cathedral.hdr")
    far = cv2.resize(far, (512, 256), interpolation=cv2.INTER_AREA)
    sides = [surface(spots(number)) for number in range(4)]
    shapes = box("box", sides, surface(spots(5)), moved(0, 0, -0.2, size=(0.8, 0.8, 0.8)))
    shapes |= floor(surface(spots(9)), half=1.7)
    gold = {"type": "roughconductor", "material": "Au", "alpha": 0.25}
    shapes["ball"] = {"type": "sphere", "center": [1.2, 0.9, -0.6], "radius": 0.4, "bsdf": gold}
    poses = ring(24, radius=4.0, height=0.9)
    return Scene("probe-farfield", shapes, far, poses, width=240, height=180, samples=24)


def photographed(made: Scene, folder: Path) -> tuple[Path, np.ndarray]:
    """A session with the true poses, and the light of its views [V, H, W, 3]."""
    light = made.light()
    light *= MIDDLE / float(np.median(light))
    if (folder / "calibration" / "calibration.json").exists():
        return folder, SIGNAL * light
    session(folder, light)
    opened = Session.open(folder)
    views = []
    for frame, pose in enumerate(made.poses):
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True, scalar_first=True).tolist()
        place = Pose(quaternion=tuple(turn), translation=tuple(pose[:3, 3].tolist()))
        views.append(ViewCalibration(camera="cam", frame=frame, cam_from_world=place, points=0))
    lens = Lens(
        model="SIMPLE_RADIAL", width=made.width, height=made.height, fx=made.focal, fy=made.focal,
        cx=made.width / 2, cy=made.height / 2,
    )  # fmt: skip
    camera = CameraCalibration(
        name="cam", serial="1", lens=lens, noise=SensorNoise(gain=GAIN, read_noise=READ),
        response=Response(kind="linear", evidence="RAW"),
    )  # fmt: skip
    record = CalibrationRecord(
        created=datetime.now(UTC), versions={}, shots_sha256=store.sha256(folder / "shots.jsonl"),
        cameras=(camera,), views=tuple(views),
        exposure_scale={shot.file: shot.exposure.scale for shot in opened.shots() if shot.exposure},
    )  # fmt: skip
    (folder / "calibration" / "colmap").mkdir(parents=True)
    pycolmap.Reconstruction().write(str(folder / "calibration" / "colmap"))
    store.write_json(folder / "calibration" / "calibration.json", record.model_dump(mode="json"))
    return folder, SIGNAL * light


def far_pixels(made: Scene, frame: int) -> np.ndarray:
    """Return where nothing but the probe is seen, bool [H, W]: rays that miss ground, crate and ball."""
    turn, shift = made.poses[frame][:3, :3], made.poses[frame][:3, 3]
    centre = -turn.T @ shift
    y, x = np.mgrid[: made.height, : made.width] + 0.5
    towards = np.stack([x - made.width / 2, y - made.height / 2, np.full(x.shape, made.focal)], -1) @ turn
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    ground = (-1 - centre[2]) / towards[..., 2]
    where = centre + ground[..., None] * towards
    near = (ground > 0) & (np.abs(where[..., :2]) < 1.7).all(-1)
    ends = [(np.array(corner) - centre) / towards for corner in ((-0.8, -0.8, -1.0), (0.8, 0.8, 0.6))]
    enter, leave = np.minimum(*ends).max(-1), np.maximum(*ends).min(-1)
    near |= (leave > enter) & (leave > 0)
    offset = centre - np.array([1.2, 0.9, -0.6])
    along = towards @ offset
    near |= (along**2 - offset @ offset + 0.4**2 > 0) & (along < 0)
    return np.asarray(~near)


def stops(made: Path, truth: np.ndarray, scene_: Scene) -> dict[str, float]:
    """Median error of held-out luminance in stops: of all pixels, far ones and near ones; mean over views."""
    opened = open_scene(made)
    rows = []
    for view in opened.views:
        if view.use == "training":
            continue
        true = truth[view.frame] @ LUMINANCE
        least = float(np.median(true)) / 1000
        rendered = opened.render(view.splat_camera) @ LUMINANCE
        off = np.abs(np.log2(np.maximum(rendered, least) / np.maximum(true, least)))
        far = far_pixels(scene_, view.frame)
        rows.append([np.median(off), np.median(off[far]), np.median(off[~far])])
    return dict(zip(("all", "far", "near"), np.mean(rows, axis=0).tolist(), strict=True))


def measure(options: argparse.Namespace) -> dict[str, Any]:
    made = scene()
    folder, truth = photographed(made, options.work / "far-field")
    iterations = 40 if options.quick else 300
    rows = []
    for seed in range(1 if options.quick else options.seeds):
        for there in (False, True):
            overrides = Overrides(environment=there, iterations=iterations)
            out = reconstruct(
                folder,
                TrainingRequest(
                    quality="draft", seed=seed, overrides=overrides, name="far-field", replace=True
                ),
            )
            model = open_scene(out).record
            rows.append(
                {
                    "environment": there, "seed": seed, "gaussians": model.gaussians,
                    "held_out_db": model.held_out_db, "ms": 1e3 * model.train_seconds / model.iterations,
                    **stops(out, truth, made),
                }
            )  # fmt: skip
            shutil.rmtree(out)
    return {"machine": machine(), "iterations": iterations, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Light from far away",
        "",
        "`python -m bench.recon.parts.far_field --write`: objects in Grace Cathedral, 24 views of 240 px all "
        f"around, path-traced; RAW brackets, true poses, draft, {result['iterations']} iterations. "
        f"{words(result['machine'])}.",
        "",
        "Median error of the luminance of held-out views, stops: of all pixels, of those that show nothing "
        "but the probe, and of the others. Held-out dB are of the photographs.",
        "",
        "| environment | seed | all | far | near | held-out, dB | Gaussians | ms an iteration |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        lines.append(
            f"| {'yes' if row['environment'] else 'no'} | {row['seed']} | {row['all']:.3f} "
            f"| {row['far']:.3f} | {row['near']:.3f} | {row['held_out_db']:.2f} "
            f"| {row['gaussians']:,} | {row['ms']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__, seeds=2).parse_args()
    result = measure(options)
    deliver(options, "far_field", result, report(result))


if __name__ == "__main__":
    main()
