"""The whole way: photographs of two cameras back to back in a simulated hall, and what is told of them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.adjustment.bundle_adjustment import Free
from calib.calibrate import calibrate
from calib.light import vignetting
from drivers.sim.mounting import look_at
from drivers.sim.scene.scene import Builder, Scene
from drivers.sim.scene.texture import BRICKS, SPOTS, TILES
from imaging.files import store
from imaging.optics.lens import Lens
from imaging.progress import unreported
from imaging.session.calibration import MOTION
from tests.calib.conftest import make_session

FRAMES = 6
LENS = Lens(model="SIMPLE_RADIAL", width=256, height=192, fx=190.0, fy=190.0, cx=128.0, cy=96.0)
BACK_FROM_FRONT = np.eye(4)
BACK_FROM_FRONT[:3, :3] = Rotation.from_euler("yxz", (178.0, 3.0, -2.0), degrees=True).as_matrix()
BACK_FROM_FRONT[:3, 3] = 0.04, 0.02, -0.2


def hall() -> Scene:
    """A room with boxes in the air, every surface of its own pattern, under even light."""
    rng = np.random.default_rng(4)
    build = Builder()
    patterns = (TILES, SPOTS, BRICKS)

    def surface(number: int, cell: float) -> int:
        colours = [(float(r), float(g), float(b)) for r, g, b in rng.uniform(0.05, 0.8, (3, 3))]
        return build.material(patterns[number % 3], cell, *colours, edge=0.3, warp=0.5, detail=0.3)

    first, *rest = (surface(number, 0.22) for number in range(6))
    build.room((first, rest[0], rest[1], rest[2], rest[3], rest[4]), (-3.0, -3.0, 0.0), (3.0, 3.0, 2.6))
    for number, (x, y) in enumerate(rng.uniform(0.6, 2.4, (14, 2)) * rng.choice([-1, 1], (14, 1))):
        wide, deep, high = rng.uniform(0.25, 0.6, 3)
        place = (float(x), float(y), float(rng.uniform(0.3, 2.2)))
        build.box(surface(number, 0.09), place, (wide, deep, high), turn=float(rng.uniform(0, 90)))
    return build.scene((1.0, 1.0, 1.0))


def front(frame: int) -> np.ndarray:
    """front_from_world of a rig in a hand, [4, 4]."""
    swing = np.sin(np.array([1.3, 2.1, 1.9]) * frame + np.array([1.0, 1.5, 0.0]))
    eye = np.array([0.4 * np.sin(1.1 * frame), 0.4 * np.cos(0.8 * frame), 1.3 + 0.2 * np.sin(1.7 * frame)])
    ahead = np.array([1 + 0.25 * swing[0], 1 - 0.25 * swing[0], 0.25 * swing[1]])
    return look_at(eye, eye + ahead, 0.2 * swing[2])


def photographed(folder: Path) -> Path:
    """A session of what both cameras of the bar see at each frame."""
    scene, views, names = hall(), [], []
    for frame in range(FRAMES):
        pose = front(frame)
        for name, cam_from_world in (("front", pose), ("back", BACK_FROM_FRONT @ pose)):
            light = np.clip(1.2 * scene.render(LENS, cam_from_world, 2), 0, 1)
            views.append([(np.rint(255 * light ** (1 / 2.2)).astype(np.uint8), None)])
            names.append(name)
    make_session(folder, views, cameras=names)
    identity = store.read_json(folder / "session.json")
    for camera in identity["cameras"]:
        camera["rig"] = "bar"
    store.write_json(folder / "session.json", identity)
    return folder


def test_both_cameras_are_placed_and_how_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but what its light and further terms of lenses are."""
    none = vignetting.Falloff(
        {"front": (0.0, 0.0, 0.0), "back": (0.0, 0.0, 0.0)}, {"front": 1.0, "back": 1.0}, ()
    )
    monkeypatch.setattr("calib.poses.adjusted.climb", lambda *rest: (Free(), ()))
    monkeypatch.setattr(vignetting, "estimate", lambda *rest, **more: none)
    session = photographed(tmp_path / "S")
    record = calibrate(session, on_progress=unreported)
    assert record.unregistered == ()
    cameras = [record.camera(name) for name in ("back", "front")]
    back, front = (camera.cam_from_rig for camera in cameras)
    assert back is not None
    assert front is not None
    mounted = back.matrix() @ np.linalg.inv(front.matrix())
    off = np.degrees(Rotation.from_matrix(mounted[:3, :3] @ BACK_FROM_FRONT[:3, :3].T).magnitude())
    stated = [camera.cam_from_rig_error for camera in cameras]
    assert off < 0.2
    assert off < 2.8 * max(error.rotation for error in stated if error is not None) < 0.3
    # No board gave the scene metres; the direction is right all the same.
    towards = mounted[:3, 3] / np.linalg.norm(mounted[:3, 3])
    true = BACK_FROM_FRONT[:3, 3] / np.linalg.norm(BACK_FROM_FRONT[:3, 3])
    assert towards @ true > np.cos(np.radians(3.0))
    (rung,) = (rung for rung in record.rungs if rung.name == MOTION)
    assert rung.taken
    assert "in 6 frames shows how they are mounted" in rung.reason
