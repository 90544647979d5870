"""Errors of a calibration against the truth, for calibrations whose errors are known."""

import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from drivers.sim.truth import pose_of
from imaging import metrics
from imaging.files import store
from imaging.files.exr.writing import write_exr
from imaging.optics.pose import Pose
from imaging.session.calibration import read_calibration
from imaging.session.view_id import ViewId
from recon.measure.truth import calibration_errors, has_truth, response_rmse, true_radiance


@pytest.mark.parametrize("kind", ["ldr", "raw"])
@pytest.mark.parametrize("width", [161, 160, 128, 80, 64])
def test_the_truth_of_a_smaller_view_is_the_whole_picture_made_smaller(tmp_path, width, kind):
    """A perfect reconstruction is perfect at any width, whether or not it divides that of the truth."""
    y, x = np.mgrid[:121, :161] / 160
    light = np.stack([np.exp(3 * np.sin(9 * x + 2 * y)), np.exp(2 * np.cos(7 * y)), 0.5 + x * y], -1)
    store.make_folder(tmp_path / "truth" / "0000")
    write_exr(tmp_path / "truth" / "0000" / "cam.exr", light.astype(np.float32))
    # A mosaic of odd size loses its last row and column; all else is a change of scale.
    whole = light[:120, :160] if kind == "raw" else light
    if kind == "raw" and width == 161:
        return
    height = round(whole.shape[0] * width / whole.shape[1])
    lens = SimpleNamespace(width=width, height=height)
    view = SimpleNamespace(id=ViewId(0, "cam"), lens=lens, sensor=SimpleNamespace(kind=kind, cfa=None))
    perfect = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    assert metrics.hdr_psnr_mu(perfect, true_radiance(tmp_path, view)) > 130


def edit(session, change):
    path = session / "calibration" / "calibration.json"
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))
    return calibration_errors(session, read_calibration(session))


def rotation(axis, degrees):
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def test_another_similarity_frame_is_no_error(session_copy):
    """SfM has its own origin, axes and unit: none of them may count."""
    turn, shift, scale = rotation((1, 2, -1), 77.0), np.array([3.0, -8.0, 1.0]), 4.2

    def move(record):
        for view in record["views"]:
            motion = Pose.model_validate(view["cam_from_world"]).matrix()
            moved = np.eye(4)
            # x_sfm = scale * turn @ x + shift; the camera's own axes scale with the world.
            moved[:3, :3] = motion[:3, :3] @ turn.T
            moved[:3, 3] = scale * motion[:3, 3] - moved[:3, :3] @ shift
            view["cam_from_world"] = pose_of(moved).model_dump(mode="json")

    errors = edit(session_copy, move)
    assert has_truth(session_copy)
    assert errors["pose_rotation_deg_max"] < 1e-5
    assert errors["pose_translation_relative_max"] < 1e-7


def test_one_view_turned_and_moved_is_found(session_copy):
    sizes = []

    def spoil(record):
        motions = [Pose.model_validate(view["cam_from_world"]).matrix() for view in record["views"]]
        centres = np.array([-m[:3, :3].T @ m[:3, 3] for m in motions])
        sizes.append(np.linalg.norm(centres[:, None] - centres[None], axis=-1).max())
        spoiled = motions[2].copy()
        spoiled[:3, :3] = rotation((0, 1, 0), 3.0) @ spoiled[:3, :3]
        centre = centres[2] + 0.05 * sizes[0] * np.array([0, 0, 1.0])
        spoiled[:3, 3] = -spoiled[:3, :3] @ centre
        record["views"][2]["cam_from_world"] = pose_of(spoiled).model_dump(mode="json")

    errors = edit(session_copy, spoil)
    # The mean of six orientations moves by a sixth of the error of one of them.
    assert errors["pose_rotation_deg_max"] == pytest.approx(3.0 * 5 / 6, rel=0.05)
    assert errors["pose_rotation_deg"] == pytest.approx(0.5, rel=0.05)
    assert 0.02 < errors["pose_translation_relative_max"] < 0.06


def test_exposure_and_gain_errors(session_copy):
    def spoil(record):
        shortest = {min(group, key=group.get) for group in brackets(record).values()}
        for file in shortest:
            record["exposure_scale"][file] *= 1.02
        record["cameras"][0]["gain"] *= 1.1

    def brackets(record):
        groups = {}
        for file, scale in record["exposure_scale"].items():
            groups.setdefault(file.rsplit("_", 1)[0], {})[file] = scale
        return groups

    errors = edit(session_copy, spoil)
    assert errors["exposure_ratio_error_max"] == pytest.approx(0.02, rel=1e-6)
    assert errors["exposure_ratio_error"] == pytest.approx(0.01, rel=1e-6)  # half of the ratios
    # One of two cameras: the geometric mean takes half of it.
    assert errors["gain_error"] == pytest.approx(np.sqrt(1.1) - 1, rel=1e-6)
    assert errors["read_noise_error"] == pytest.approx(0, abs=1e-9)


def test_a_response_is_right_up_to_a_shift_in_exposure(toy_ldr, toy):
    truth = json.loads((toy_ldr / "truth" / "truth.json").read_text())["response"]
    codes, logs = np.array(truth["codes"]), np.array(truth["log_exposure"][0])

    def shifted(at):
        return np.interp(at + 0.37, logs, codes)[:, None].repeat(3, 1)

    assert response_rmse(toy_ldr, shifted) < 2e-3

    def wrong(at):
        return shifted(at) + 0.03 * np.sin(5 * at)[:, None]

    assert 0.01 < response_rmse(toy_ldr, wrong) < 0.04
    assert response_rmse(toy, shifted) is None
