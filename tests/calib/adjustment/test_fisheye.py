"""A fisheye from a scene alone: taken, and with it what lies at the corners."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.adjustment import lens_ladder
from calib.adjustment.bundle_adjustment import Free, lens_of, set_model
from calib.data.features import Features
from calib.poses.pose_inputs import PoseInputs
from calib.poses.sfm import solve
from drivers.sim.camera import lens as simulated
from imaging.files.colmap import pycolmap
from imaging.optics import lens as optics
from imaging.optics.lens import Lens
from imaging.progress import unreported
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, COUNT = 640, 480, 500
TRUE = Lens(
    model="OPENCV_FISHEYE", width=WIDTH, height=HEIGHT, fx=371, fy=371, cx=320.3, cy=239.6,
    k1=0.03, k2=-0.015, k3=0.002, k4=-0.0005,
)  # fmt: skip
GUESS = Lens(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=420, fy=420, cx=320, cy=240)


def pose(frame: int) -> np.ndarray:
    """On an arc, high and low in turn and rolled: an arc about one axis does not tell fy from fx."""
    motion = np.eye(4)
    turns = (9.0 * frame, (-12.0, 12.0)[frame % 2], 15.0 * (frame % 3))
    motion[:3, :3] = Rotation.from_euler("yxz", turns, degrees=True).as_matrix()
    motion[2, 3] = 4.0
    return motion


def views(frames: int) -> dict[ViewId, Features]:
    """Points of a room of 8 by 5 by 5 as the lens sees them, good to 0.2 px, each with its descriptor."""
    rng = np.random.default_rng(7)
    points = rng.uniform(-1, 1, (COUNT, 3)) * (4.0, 2.5, 2.5) + (0, 0, 0.5)
    descriptors = rng.exponential(30, (COUNT, 128))
    features = {}
    for frame in range(frames):
        local = points @ pose(frame)[:3, :3].T + pose(frame)[:3, 3]
        ahead = np.flatnonzero(local[:, 2] > 0.2)
        pixels = simulated.project(TRUE, local[ahead])
        inside = (pixels > 0).all(1) & (pixels < (WIDTH, HEIGHT)).all(1)
        ids = ahead[inside]
        noisy = descriptors[ids] + rng.normal(0, 2, (len(ids), 128))
        places = pixels[inside] + rng.normal(0, 0.2, (len(ids), 2))
        features[ViewId(frame, "cam")] = Features(places, np.clip(noisy, 0, 255).astype(np.uint8))
    return features


def test_a_fisheye_is_found_with_its_corners() -> None:
    """A first pass with radial terms loses the corners: without the second the lens is 10 px off there."""
    features = views(6)
    model = solve(PoseInputs(features, focal_known={"cam"}), {"cam": GUESS})
    rungs = {rung.name: rung for rung in model.rungs}
    assert len(rungs) == len(model.rungs)
    assert rungs["lens_fisheye"].taken
    lens = model.lenses["cam"]
    assert lens.fisheye
    assert len(model.poses) == 6
    assert sum(model.points.values()) > 0.95 * sum(len(of_view.points) for of_view in features.values())
    x, y = np.meshgrid(np.linspace(20, 620, 9), np.linspace(20, 460, 7))
    rays = optics.rays(TRUE, np.stack([x.ravel(), y.ravel()], 1))
    assert np.abs(optics.project(lens, rays) - optics.project(TRUE, rays)).max() < 1.5
    assert model.errors is not None
    errors = model.errors.lenses["cam"]
    assert abs(lens.fx - TRUE.fx) < 4 * errors["fx"] < 8
    assert abs(lens.k1 - TRUE.k1) < 4 * errors["k1"] < 0.05
    for frame in range(1, 6):
        relative = model.poses[ViewId(frame, "cam")].matrix() @ np.linalg.inv(
            model.poses[ViewId(0, "cam")].matrix()
        )
        true = pose(frame) @ np.linalg.inv(pose(0))
        trace = np.trace(relative[:3, :3].T @ true[:3, :3])
        assert np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1))) < 0.15


def wide(model: str, *terms: float) -> Any:
    return pycolmap.Camera(model=model, width=WIDTH, height=HEIGHT, params=[371.0, 320.3, 239.6, *terms])


def test_a_fisheye_keeps_its_terms_when_it_gets_more() -> None:
    """And is the lens that COLMAP, too, takes it for."""
    camera = wide("RADIAL_FISHEYE", 0.03, -0.015)
    few = lens_of(camera)
    assert few.fisheye
    set_model(camera, "OPENCV_FISHEYE")
    more = lens_of(camera)
    assert more.terms == few.terms
    rays = np.random.default_rng(0).normal(size=(50, 3)) * (0.7, 0.7, 0.1) + (0, 0, 1)
    for lens, camera_of_lens in ((few, wide("RADIAL_FISHEYE", 0.03, -0.015)), (more, camera)):
        np.testing.assert_allclose(optics.project(lens, rays), camera_of_lens.img_from_cam(rays), atol=1e-9)
    set_model(camera, "RADIAL_FISHEYE")
    assert lens_of(camera).terms == few.terms


def test_terms_that_fold_a_lens_over_within_its_image_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Points near the middle may ask for what no lens does at the corners, and no renderer can draw."""
    folding = pycolmap.Reconstruction()
    folding.add_camera_with_trivial_rig(wide("RADIAL_FISHEYE", 0.03, -0.4))
    straight = pycolmap.Reconstruction()
    straight.add_camera_with_trivial_rig(wide("RADIAL_FISHEYE", 0.03, -0.015))
    monkeypatch.setattr(lens_ladder, "adjust", lambda *rest: None)
    free = Free("RADIAL_FISHEYE")
    assert lens_ladder._folds(folding, free, 1.0, 1)
    assert not lens_ladder._folds(straight, free, 1.0, 1)

    losses = iter(
        (loss, np.ones(4)) for loss in (np.full(4, 2.0), np.full(4, 2.1), np.array([1.0, 1.1, 0.9, 1.0]))
    )
    monkeypatch.setattr(lens_ladder, "_held_out", lambda *rest: next(losses))
    monkeypatch.setattr(lens_ladder, "_judges", lambda reconstruction: folding)
    monkeypatch.setattr(lens_ladder, "FEWEST_VIEWS", 0)
    climbed, rungs = lens_ladder.climb(folding, free, 1.0, 1, unreported)
    assert climbed == free
    assert rungs[-1].name == "lens_fisheye_far"
    assert "fold a lens over" in rungs[-1].reason
