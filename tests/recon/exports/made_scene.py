"""Scenes that nobody trained: Gaussians of 18 stops before two bent cameras, in folders as `rig` has them."""

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from imaging.files import store
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.calibration import CalibrationRecord
from imaging.session.coordinates import CoordinateSystem
from imaging.session.records import Band
from recon.data.world import WorldTransform
from recon.decide.settings import Settings
from recon.result.model import CALIBRATION, CHECKPOINT, MODEL, ModelRecord, SceneShot, SceneView
from recon.scene.checkpoint import Checkpoint, write_checkpoint
from recon.scene.environment import Environment

STOPS = 18.0
WORLD = WorldTransform(origin=(3.0, -2.0, 1.5), unit=2.5)
TILT = Rotation.from_euler("xyz", [0.2, -0.1, 0.15])
"""Angle of the cameras from level."""


def write_made(
    folder: Path,
    *,
    count: int = 400,
    degree: int = 0,
    sky: bool = False,
    survey: bool = False,
    bands: tuple[Band, ...] = (),
    bent: bool = True,
    frames: int = 2,
    seed: int = 0,
) -> Path:
    """The folder of a scene; light of 1 in its unit is 7, its luminance 250 cd/m2."""
    rng = np.random.default_rng(seed)
    channels = len(bands) or 3
    tensors = {
        "means": rng.normal(0, 0.35, (count, 3)),
        "log_scales": np.log(0.06) + rng.normal(0, 0.4, (count, 3)),
        "quats": rng.normal(0, 1, (count, 4)) * 3,
        "opacity_logits": rng.normal(1, 2, count),
        "ln_luminance": (rng.random(count) - 0.75) * STOPS * math.log(2),
        "chroma_dc": rng.normal(0, 3, (count, 1, channels)),
        "chroma_rest": rng.normal(0, 0.5 if degree else 0.0, (count, 8, channels)),
    }
    parts = {
        f"gaussians.{name}": torch.from_numpy(value.astype(np.float32)) for name, value in tensors.items()
    }
    if sky:
        rows = 32
        axes = Rotation.from_euler("xyz", [0.4, 0.7, -0.3]).as_matrix()
        ln_light = rng.normal(-4, 1, (3, rows, 2 * rows))
        far = Environment(torch.from_numpy(ln_light.astype(np.float32)), axes)
        parts |= {f"environment.{name}": value for name, value in far.tensors().items()}
    folder.mkdir(parents=True, exist_ok=True)
    write_checkpoint(folder / CHECKPOINT, Checkpoint(parts, {}))
    record = ModelRecord(
        created=datetime(2026, 1, 1, tzinfo=UTC),
        versions={},
        settings=Settings(
            method="nh-3dgs", quality="draft", seed=0, iterations=30, max_gaussians=count, max_width=48
        ),
        session="made",
        photographs_sha256="",
        calibration_sha256="",
        normaliser=7.0,
        reference=2.0**-20,
        display=None,
        radiance="relative to camera signal = radiance x exposure scale",
        luminance=None if bands else (250.0, 10.0),
        world=WORLD,
        offset=(0.0, 0.0, 0.0),
        exposure=1.75,
        display_db=30.0,
        degree=degree,
        bands=bands,
        views=tuple(_view(name, frame, bent) for frame in range(frames) for name in ("a-1", "a.1")),
        gaussians=count,
        train_seconds=1.0,
        measuring_seconds=0.0,
        device="none",
        loss=None,
        rungs=(),
        iterations=30,
        schedule=((0, 0.0), (30, 30.0)),
        ending="schedule",
        held_out_db=None,
        predicted=None,
    )
    store.write_json(folder / MODEL, record.model_dump(mode="json"))
    _write_calibration(folder, survey)
    return folder


def _view(camera: str, frame: int, bent: bool) -> SceneView:
    """Turned about the middle of the scene, 2.5 scene units away, pictures off the axis."""
    around = Rotation.from_euler("y", 0.4 * frame + (0.2 if camera == "a.1" else 0.0))
    turn = around.as_matrix() @ TILT.as_matrix()
    w, x, y, z = Rotation.from_matrix(turn).as_quat(canonical=True, scalar_first=True).tolist()
    a, b, c = (np.array([0.0, 0.0, 2.5 * WORLD.unit]) - turn @ WORLD.origin).tolist()
    terms = {"k1": -0.15, "k2": 0.02, "p1": 0.003, "p2": -0.002} if bent else {}
    return SceneView(
        camera=camera,
        frame=frame,
        use="test" if (camera, frame) == ("a.1", 1) else "training",
        lens=Lens(model="OPENCV", width=48, height=36, fx=50.0, fy=47.0, cx=22.0, cy=19.5, **terms),
        cam_from_world=Pose(quaternion=(w, x, y, z), translation=(a, b, c)),
        shots=(SceneShot(file=f"raw/{frame:04d}/{camera}_0.dng", k=0.01),),
    )


def _write_calibration(folder: Path, survey: bool) -> None:
    system = CoordinateSystem(
        source="survey",
        system="EPSG:25832",
        offset=(450000.0, 5410000.0, 300.0),
        rms=0.001,
        scale_error=1e-5,
        rotation_error=0.01,
        position_error=0.001,
        used=4,
    )
    record = CalibrationRecord(
        created=datetime(2026, 1, 1, tzinfo=UTC),
        versions={},
        shots_sha256="",
        cameras=(),
        views=(),
        unit="m" if survey else "relative",
        coordinates=system if survey else None,
        exposure_scale={},
    )
    store.write_json(folder / CALIBRATION, record.model_dump(mode="json"))
