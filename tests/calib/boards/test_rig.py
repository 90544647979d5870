"""Lenses and rigs from corners with known noise, against the rig that was simulated."""

import numpy as np
import pytest

from calib.boards import ladder, rig, uncertainty
from calib.boards.corners import Corners
from calib.boards.first_guess import first_guess
from calib.boards.measure import DISAGREE, places_of, solve_group
from drivers.sim.camera.lens import project
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.optics.lens import Lens
from imaging.progress import unreported
from imaging.session.view_id import ViewId
from tests.calib.boards.conftest import HEIGHT, WIDTH, Stage, stage_of


@pytest.fixture
def fewer_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Standard errors of 20 draws, which are known to a sixth of themselves."""
    monkeypatch.setattr(uncertainty, "DRAWS", 20)


def errors_of(stage: Stage, mounted: dict[str, Array]) -> tuple[list[float], list[float]]:
    """Degrees and millimetres by which cameras lie beside their true places, as the reference sees them."""
    reference = next(name for name, pose in mounted.items() if np.allclose(pose, np.eye(4)))
    turns, shifts = [], []
    for name, pose in mounted.items():
        true = stage.relative(name, reference)
        apart = pose @ np.linalg.inv(true)
        sine = np.linalg.norm(apart[:3, :3] - apart[:3, :3].T) / np.sqrt(8)
        turns.append(float(np.degrees(np.arcsin(sine))))
        there, here = (-one[:3, :3].T @ one[:3, 3] for one in (true, pose))
        shifts.append(float(1000 * np.linalg.norm(there - here)))
    return turns, shifts


@pytest.mark.usefixtures("fewer_draws")
def test_a_board_places_the_rig_to_the_figures(stage: Stage) -> None:
    """25 partial views of 4 cameras, corners good to 0.06 px, one in a hundred wrong."""
    group = solve_group(stage.board, stage.detected(25, wrong=0.01), stage.sizes, unreported)
    assert group.solved is not None
    assert group.doubt is not None
    turns, shifts = errors_of(stage, group.solved.cam_from_rig)
    assert max(turns) < 0.05
    assert max(shifts) < 0.3
    assert group.solved.rms < 0.1
    assert max(group.doubt.halves.values()) < DISAGREE
    number = {mount.name: index for index, mount in enumerate(stage.rig.mounts)}
    places = places_of(group.solved)
    assert len(places) == 25
    for place in places:
        true = stage.cam_from_board(number[place.cameras[0]], place.frame)
        np.testing.assert_allclose(place.cam_from_board.matrix(), true, atol=5e-3)
    taken = {rung.name for rung in group.rungs if rung.taken}
    assert "lens_radial_1" in taken  # the simulated lenses have it, and the rest is next to nothing
    for mount in stage.rig.mounts:
        lens, true = group.solved.lenses[mount.name], mount.optics.lens
        doubt = group.doubt.lenses[mount.name]
        assert abs(lens.fx - true.fx) < 5 * doubt["fx"] < 2.0
        away = uncertainty.projection_map(true, [lens])
        assert away.max() < 5 * group.doubt.map[mount.name].max() < 1.0


@pytest.mark.usefixtures("fewer_draws")
def test_the_true_rig_lies_within_what_is_stated() -> None:
    """Check errors in a plane and an axis: 95 % lie within 2.8 standard errors of the worst axis or more."""
    inside, stated = [], []
    for seed in range(40, 44):
        stage = stage_of(seed)
        group = solve_group(stage.board, stage.detected(14, wrong=0.005), stage.sizes, unreported)
        assert group.solved is not None
        assert group.doubt is not None
        turns, shifts = errors_of(stage, group.solved.cam_from_rig)
        for name, turn, shift in zip(group.solved.cam_from_rig, turns, shifts, strict=True):
            if group.doubt.rotation[name] > 0:
                stated.append(group.doubt.rotation[name])
                inside.append(turn < 2.8 * group.doubt.rotation[name])
                inside.append(shift < 2800 * group.doubt.translation[name])
    assert np.mean(inside) >= 0.85
    assert len(inside) == 24
    assert 0.005 < np.median(stated) < 0.05  # errors stated too large would hold any truth


def test_wrong_corners_are_dropped_and_right_ones_kept(stage: Stage) -> None:
    detected = stage.detected(12)
    spoiled = {
        key: Corners(corners.ids, corners.points + (3.0 * (corners.ids[:, None] == corners.ids[0])))
        for key, corners in detected.items()
    }
    inliers, _ = rig.drop_outliers(
        stage.board, spoiled, first_guess(stage.board, spoiled, stage.sizes), ladder.RICHEST
    )
    for key, corners in inliers.items():
        assert spoiled[key].ids[0] not in corners.ids
    right = sum(len(corners.ids) - 1 for corners in spoiled.values())
    assert sum(len(corners.ids) for corners in inliers.values()) > 0.97 * right


def test_cameras_that_share_no_view_are_named(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uncertainty, "DRAWS", 2)  # how sure it is is not looked at
    detected = {
        view: corners
        for view, corners in stage.detected(20).items()
        if (view.camera in ("cam0", "cam1")) == (view.frame % 2 == 0)
    }
    group = solve_group(stage.board, detected, stage.sizes, unreported)
    assert len(group.isolated) == 2
    assert group.solved is not None
    assert set(group.solved.cam_from_rig).isdisjoint(group.isolated)
    turns, shifts = errors_of(stage, group.solved.cam_from_rig)
    assert max(turns) < 0.15
    assert max(shifts) < 1.0


def test_of_cameras_that_share_no_view_the_one_of_most_frames_is_calibrated(stage: Stage) -> None:
    """A name says nothing of its camera, however long it is."""
    renamed = {"cam0": "a", "cam1": "longer"}
    detected = {
        ViewId(view.frame, renamed[view.camera]): corners
        for view, corners in stage.detected(12).items()
        if view.camera == ("cam0" if view.frame >= 4 else "cam1")
    }
    begun = first_guess(stage.board, detected, dict.fromkeys(renamed.values(), (WIDTH, HEIGHT)))
    assert begun.isolated == ("longer",)


def test_too_few_views_say_what_to_shoot(stage: Stage) -> None:
    few = stage.detected(2)
    with pytest.raises(CalibrationError, match=r"in 3 frames or more.*about 25 frames"):
        first_guess(stage.board, few, stage.sizes)


def test_a_richer_lens_is_taken_when_it_is_there(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tangential terms of 2e-3 move corners by pixels; the simulated lenses have almost none."""
    import cv2

    monkeypatch.setattr(uncertainty, "DRAWS", 2)  # how sure it is is not looked at
    rng = np.random.default_rng(0)
    detected: dict[ViewId, Corners] = {}
    for frame in range(16):
        for camera, mount in enumerate(stage.rig.mounts):
            lens = mount.optics.lens
            pose = stage.cam_from_board(camera, frame)
            corners = stage.board.corners() @ pose[:3, :3].T + pose[:3, 3]
            matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1.0]])
            terms = np.array([-0.2, 0.05, 2e-3, -1e-3])
            points, _ = cv2.projectPoints(corners, np.zeros(3), np.zeros(3), matrix, terms)
            points = points.reshape(-1, 2) + rng.normal(0, 0.05, (len(corners), 2))
            plain = project(lens, corners)  # far outside the terms fold over
            ids = np.flatnonzero((plain > 0).all(1) & (plain < (WIDTH, HEIGHT)).all(1) & (corners[:, 2] > 0))
            if len(ids) >= 6:
                detected[ViewId(frame, mount.name)] = Corners(ids, points[ids])
    group = solve_group(stage.board, detected, stage.sizes, unreported)
    assert {"lens_radial_1", "lens_radial_2", "lens_tangential"} <= {r.name for r in group.rungs if r.taken}
    assert group.solved is not None
    for lens in group.solved.lenses.values():
        assert lens.p1 == pytest.approx(2e-3, abs=2e-4)
        assert lens.k1 == pytest.approx(-0.2, abs=0.01)


@pytest.mark.usefixtures("fewer_draws")
def test_a_lens_that_changes_meanwhile_is_found_by_halves(stage: Stage) -> None:
    """The focus of one camera is turned in every second frame, which stretches its image by 1 %."""
    middle = np.array((WIDTH / 2, HEIGHT / 2))
    detected = {
        view: Corners(
            corners.ids,
            middle + (corners.points - middle) * (1.01 if view.camera == "cam2" and view.frame % 2 else 1.0),
        )
        for view, corners in stage.detected(16).items()
    }
    group = solve_group(stage.board, detected, stage.sizes, unreported)
    assert group.doubt is not None
    ratios = group.doubt.halves
    assert max(ratios, key=lambda name: ratios[name]) == "cam2"
    assert ratios["cam2"] > DISAGREE


def test_the_same_corners_give_the_same_rig(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uncertainty, "DRAWS", 6)
    detected = stage.detected(8)
    one, other = (solve_group(stage.board, detected, stage.sizes, unreported) for _ in range(2))
    assert one.solved is not None
    assert other.solved is not None
    for name, pose in one.solved.cam_from_rig.items():
        assert np.array_equal(pose, other.solved.cam_from_rig[name])
    assert one.doubt is not None
    assert other.doubt is not None
    assert one.doubt.lenses == other.doubt.lenses


def test_where_drawn_lenses_fold_over_nothing_is_known() -> None:
    """A lens whose terms turn back before the corners says nothing of them, and spoils nothing else."""
    lens = Lens(model="OPENCV", width=320, height=240, fx=312.0, fy=312.0, cx=160.0, cy=120.0, k1=-0.06)
    folded = lens.model_copy(update={"k1": 0.1, "k2": -1.6})  # up to 155 px; the corners are at 174
    near = lens.model_copy(update={"k1": -0.05})
    plain = uncertainty.projection_map(lens, [near])
    both = uncertainty.projection_map(lens, [near, folded])
    assert np.isfinite(plain).all()
    assert np.isinf(both[0, 0])
    assert np.isinf(both[-1, -1])
    assert np.isfinite(both[2:4, 1:8]).all()
    assert np.isinf(uncertainty.projection_map(folded, [lens])[0, 0])
    everywhere = lens.model_copy(update={"k1": -1e6})
    assert np.isinf(uncertainty.projection_map(lens, [everywhere])).all()


def test_corners_with_large_errors_still_give_a_calibration(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six frames in the middle of the image, corners off by 1.5 px: what cannot be known is told so."""
    monkeypatch.setattr(uncertainty, "DRAWS", 8)
    middle = np.array((WIDTH / 2, HEIGHT / 2))
    detected = {}
    for key, corners in stage.detected(7, noise=1.5).items():
        near = np.linalg.norm(corners.points - middle, axis=1) < 0.3 * WIDTH
        if near.sum() >= 6:
            detected[key] = Corners(corners.ids[near], corners.points[near])
    group = solve_group(stage.board, detected, stage.sizes, unreported)
    assert group.solved is not None
    assert group.doubt is not None
    for name in group.solved.cam_from_rig:
        assert not np.isnan(group.doubt.map[name]).any()
        assert group.doubt.map[name].max() > 1.0


def test_frames_drawn_that_give_no_lens_are_counted(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uncertainty, "DRAWS", 6)
    detected = stage.detected(7)
    group = solve_group(stage.board, detected, stage.sizes, unreported)
    assert group.solved is not None
    calls = []
    whole = rig.solve

    def failing(*given: object, **options: object) -> rig.Solved:
        calls.append(1)
        if len(calls) % 3 == 0:
            raise CalibrationError("no lens")
        return whole(*given, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(uncertainty, "solve", failing)
    doubt = uncertainty.bootstrap(stage.board, detected, group.solved, ladder.RICHEST, unreported)
    assert doubt.failed == 2
    assert doubt.draws == 4
    calls[:] = [1, 1]  # the next one, of all frames together, fails
    doubt = uncertainty.bootstrap(stage.board, detected, group.solved, ladder.RICHEST, unreported)
    assert doubt.draws == 0
    assert doubt.lenses == {}
