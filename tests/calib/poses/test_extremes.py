"""Pictures at the ends of what a session may hold: poses are right, or the cause is named."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.calibrate import calibrate
from drivers.sim.rigs import simulate
from imaging.arrays import Array
from imaging.errors import CalibrationError, ReconstructionError
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.session.calibration import read_calibration
from recon.data.load import load
from tests.calib.conftest import make_session

Shot = tuple[RawMosaic, Exposure]
WIDTH, HEIGHT, VIEWS = 160, 120, 4
GAIN, READ, WELL, BLACK = 0.4, 3.0, 9500.0, 256
WHITE = BLACK + int(GAIN * WELL)
USUAL = (1 / 1024, 1 / 64, 1 / 4)


@pytest.fixture(scope="module")
def scene() -> tuple[Array, Array]:
    """Light [V, H, W, 3] of one camera at four places, and its true poses [V, 4, 4]."""
    rig = simulate("demo", 3, cameras=1, positions=VIEWS, width=WIDTH, height=HEIGHT, samples=2)
    light = np.stack([rig.radiance(0, frame) for frame in range(VIEWS)]).astype(np.float64)
    return light, np.stack([rig.cam_from_world(0, frame) for frame in range(VIEWS)])


def expose(light: Array, time: float, rng: np.random.Generator, label: float | None = None) -> Shot:
    """One exposure of light [H, W, 3]; label: the time that its file states, if another."""
    sites = np.empty(light.shape[:2])
    for (row, column), channel in zip(((0, 0), (0, 1), (1, 0), (1, 1)), (0, 1, 1, 2), strict=True):
        sites[row::2, column::2] = light[row::2, column::2, channel]
    electrons = rng.poisson(np.minimum(WELL * sites * time, 2 * WELL)) + READ * rng.standard_normal(
        sites.shape
    )
    codes = np.clip(np.rint(BLACK + GAIN * np.minimum(electrons, WELL)), 0, WHITE).astype(np.uint16)
    span = WHITE - BLACK
    profile = (GAIN / span, (GAIN * READ / span) ** 2)
    return RawMosaic(codes, Cfa.RGGB, ((BLACK,),), WHITE, noise_profile=profile), Exposure(
        time=time if label is None else label
    )


def brackets(light: Array, times: Sequence[float]) -> list[list[Shot]]:
    rng = np.random.default_rng(0)
    return [[expose(view, time, rng) for time in times] for view in light]


def pair_errors(session: Path, true: Array) -> tuple[Array, Array]:
    """Degrees, of every pair of views: its rotation is off, and its translation's direction (NaN: none)."""
    record = calibrate(session, on_progress=unreported)
    estimated = {view.frame: view.cam_from_world.matrix() for view in record.views}
    turns, directions = [], []
    for one in range(len(true)):
        for other in range(one):
            relative, goal = (
                pose[one] @ np.linalg.inv(pose[other]) for pose in (estimated, dict(enumerate(true)))
            )
            apart = relative[:3, :3] @ goal[:3, :3].T
            turns.append(np.degrees(np.arcsin(np.linalg.norm(apart - apart.T) / np.sqrt(8))))
            here, there = relative[:3, 3], goal[:3, 3]
            angle = np.degrees(np.arctan2(np.linalg.norm(np.cross(here, there)), here @ there))
            directions.append(angle if np.linalg.norm(there) > 1e-9 else np.nan)
    return np.array(turns), np.array(directions)


def hot(views: list[list[Shot]]) -> list[list[Shot]]:
    """One photosite in two hundred saturated in all exposures."""
    sites = np.random.default_rng(1).random((HEIGHT, WIDTH)) < 0.005
    for shots in views:
        for mosaic, _ in shots:
            mosaic.pixels[sites] = WHITE
    return views


CASES: dict[str, Callable[[Array], list[list[Shot]]]] = {
    "one exposure": lambda light: brackets(light, USUAL[1:2]),
    "2^20 apart, one all white": lambda light: brackets(light, (1 / 64, 2.0**14)),
    "2^20 apart, one all black": lambda light: brackets(light, (2.0**-26, 1 / 64)),
    "the same exposure twice": lambda light: brackets(light, (1 / 64, 1 / 64, 1 / 4)),
    "hot sensor": lambda light: hot(brackets(light, USUAL)),
    "fourteen stops": lambda light: brackets(
        light * 2.0 ** np.linspace(-4, 4, WIDTH)[:, None], (2.0**-14, 2.0**-10, *USUAL[1:], 4.0)
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_poses_are_right(case: str, scene: tuple[Array, Array], tmp_path: Path) -> None:
    """Pictures of 160 px place a camera to fractions of a degree, where these do not spoil it."""
    light, true = scene
    turns, directions = pair_errors(make_session(tmp_path / "S", CASES[case](light)), true)
    assert turns.max() < 1.0
    assert directions.max() < 2.0


@pytest.mark.parametrize("shots", [range(VIEWS), [2]], ids=["all", "one view"])
def test_a_label_that_is_wrong_by_two_is_found(
    shots: Sequence[int], scene: tuple[Array, Array], tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    views = [
        [expose(view, time, rng, 2 * time if frame in shots and time == USUAL[1] else None) for time in USUAL]
        for frame, view in enumerate(scene[0])
    ]
    session = make_session(tmp_path / "S", views)
    record = calibrate(session, only="response", on_progress=unreported)
    for frame in range(VIEWS):
        scale = [record.exposure_scale[f"raw/{frame:04d}/cam_{step}.dng"] for step in range(3)]
        np.testing.assert_allclose(np.array(scale) / scale[2], np.array(USUAL) / USUAL[2], rtol=0.01)


def test_the_same_view_twice_stands_at_one_place(scene: tuple[Array, Array], tmp_path: Path) -> None:
    light, true = scene
    again = [*range(VIEWS), 1]
    session = make_session(tmp_path / "S", brackets(light[again], USUAL[1:2]))
    turns, directions = pair_errors(session, true[again])
    assert turns.max() < 1.0
    assert np.nanmax(directions) < 2.0
    poses = {view.frame: view.cam_from_world.matrix() for view in read_calibration(session).views}
    apart = np.linalg.norm([np.linalg.inv(poses[1])[:3, 3] - np.linalg.inv(poses[4])[:3, 3]])
    span = np.linalg.norm(np.linalg.inv(poses[0])[:3, 3] - np.linalg.inv(poses[3])[:3, 3])
    assert apart < 0.01 * span


def test_a_camera_that_only_turns_gets_its_turns_and_no_depth(tmp_path: Path) -> None:
    rig = simulate("demo", 3, cameras=1, positions=VIEWS, width=WIDTH, height=HEIGHT)
    turned, poses = [], []
    for frame in range(VIEWS):
        turn = np.eye(4)
        turn[:3, :3] = cv2.Rodrigues(np.array([0.02 * frame, 0.1 * frame - 0.15, 0.0]))[0]
        lens = rig.mounts[0].optics.lens
        turned.append(rig.scene.render(lens, turn @ rig.cam_from_world(0, 0), 2))
        poses.append(turn[:3, :3])
    session = make_session(tmp_path / "S", brackets(np.array(turned, np.float64), USUAL[1:2]))
    record = calibrate(session, on_progress=unreported)
    assert record.turned
    assert "turns and no depth" in record.doubts[0]
    turns = {view.frame: view.cam_from_world.matrix() for view in record.views}
    assert len(turns) == VIEWS
    for frame in range(1, VIEWS):
        apart = (poses[frame] @ poses[0].T).T @ turns[frame][:3, :3] @ turns[0][:3, :3].T
        assert np.degrees(np.linalg.norm(cv2.Rodrigues(apart)[0])) < 0.2
        assert np.linalg.norm(turns[frame][:3, 3]) < 1e-12
    with pytest.raises(ReconstructionError, match="was taken from one place"):
        load(session)


@pytest.mark.parametrize(
    ("time", "cause"), [(2.0**10, "saturated: expose shorter"), (2.0**-26, "black: expose longer")]
)
def test_brackets_that_show_nothing_are_refused(
    time: float, cause: str, scene: tuple[Array, Array], tmp_path: Path
) -> None:
    session = make_session(tmp_path / "S", brackets(scene[0], (time, 4 * time)))
    with pytest.raises(CalibrationError, match=cause):
        calibrate(session, on_progress=unreported)
