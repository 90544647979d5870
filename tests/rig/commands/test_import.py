"""`rig import` of a folder that brings its poses, and what the later stages make of it."""

import json
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from imaging.files import store
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from tests.rig.report.pages import Page, assert_self_contained


@pytest.fixture(scope="module")
def captured(tmp_path_factory) -> Path:
    """Two cameras at two frames, five exposures each, as JPEG; not to be changed."""
    from capture.simulated import capture_simulated

    folder = tmp_path_factory.mktemp("captured") / "S"
    capture_simulated("toy-ldr", folder, seed=1, frames=2)
    return folder


@pytest.fixture
def scene(captured: Path, tmp_path: Path) -> Path:
    """The same photographs as nerfstudio would have them, with the true lenses and poses."""
    truth = store.read_json(captured / "truth" / "truth.json")
    poses = {
        (entry["frame"], camera): Pose.model_validate(pose)
        for entry in truth["frames"]
        for camera, pose in entry["cam_from_world"].items()
    }
    frames = []
    for shot in Session.open(captured).shots():
        name = f"images/{shot.camera}_{shot.frame}_{shot.step}.jpg"
        (tmp_path / "scene" / "images").mkdir(parents=True, exist_ok=True)
        shutil.copy(captured / shot.file, tmp_path / "scene" / name)
        lens = Lens.model_validate(truth["cameras"][shot.camera]["lens"])
        motion = np.linalg.inv(poses[shot.frame, shot.camera].matrix()) @ np.diag([1, -1, -1, 1])
        frames.append(
            {"file_path": name, "transform_matrix": motion.tolist()}
            | {"fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy, "w": 64, "h": 48}
            | {"k1": lens.k1, "k2": lens.k2, "p1": lens.p1, "p2": lens.p2}
        )
    (tmp_path / "scene" / "transforms.json").write_text(json.dumps({"frames": frames}))
    return tmp_path / "scene"


def test_poses_come_along_and_the_response_is_added_to_them(rig, scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "S"
    code, text, err = rig("import", str(scene), str(out), "--json")
    assert (code, err) == (0, "")
    value = json.loads(text)
    assert (value["layout"], value["shots"], value["views_with_pose"], value["frames"]) == (
        "nerfstudio",
        20,
        4,
        4,
    )
    assert all("--layout photos" in guess for guess in value["guesses"] if "layout of nerfstudio" in guess)
    assert_self_contained(Page.read(out / "calibration" / "report.html"))
    before = read_calibration(out)
    assert {camera.response.kind for camera in before.cameras} == {"srgb"}

    code, text, err = rig("calibrate", str(out), "--only", "response", "--json")
    assert (code, err) == (0, "")
    assert json.loads(text)["registered"] == 4
    after = read_calibration(out)
    assert after.views == before.views
    assert [camera.lens for camera in after.cameras] == [camera.lens for camera in before.cameras]
    assert [camera.response for camera in after.cameras] != [camera.response for camera in before.cameras]
    assert [rung for rung in after.rungs if rung.name == "poses"] == list(before.rungs)


def test_photographs_that_came_without_a_pose_are_not_said_to_show_too_little(
    rig, scene: Path, tmp_path: Path
) -> None:
    whole = store.read_json(scene / "transforms.json")
    for frame in whole["frames"]:
        frame["camera_model"] = "EQUIRECTANGULAR" if "cam1" in frame["file_path"] else "OPENCV"
    (scene / "transforms.json").write_text(json.dumps(whole))
    assert rig("import", str(scene), str(tmp_path / "S"))[0] == 0
    code, _, err = rig("calibrate", str(tmp_path / "S"), "--only", "response")
    assert code == 3
    assert "10 images of 12 got no pose: cam1_0_0.jpg" in err
    assert "came without: rig calibrate without --only looks for the poses of all" in err
    assert "too little" not in err


def test_a_photo_that_is_named_and_absent_is_one_line_of_an_import_that_succeeds(
    rig, scene: Path, tmp_path: Path
) -> None:
    (scene / "images" / "cam0_1_2.jpg").unlink()
    code, text, err = rig("import", str(scene), str(tmp_path / "S"))
    assert (code, err) == (0, "")
    assert "19 photos as 4 frames" in text
    (line,) = [line for line in text.splitlines() if "not there and left out" in line]
    assert "cam0_1_2.jpg" in line


def test_the_next_command_can_be_pasted_into_a_shell(rig, scene: Path, tmp_path) -> None:
    session = tmp_path / "tøy 'späce' 名"
    code, text, _ = rig("import", str(scene), str(session), "--layout", "photos", "--together", "never")
    assert code == 0
    (command,) = [line.removeprefix("Next: ") for line in text.splitlines() if line.startswith("Next: ")]
    assert shlex.split(command) == ["rig", "calibrate", str(session)]


def test_a_pose_that_is_none_is_refused_and_plain_photographs_still_come(rig, scene: Path, tmp_path) -> None:
    text = (
        (scene / "transforms.json")
        .read_text()
        .replace('"transform_matrix": [[', '"transform_matrix": [[9', 1)
    )
    (scene / "transforms.json").write_text(text)
    code, _, err = rig("import", str(scene), str(tmp_path / "S"))
    assert code == 2
    assert "frame 0 of" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "S").exists()
    code, text, _ = rig(
        "import", str(scene), str(tmp_path / "S"), "--layout", "photos", "--together", "never"
    )
    assert code == 0
    assert "Next: rig calibrate" in text
    assert "--cameras" in text
    assert "--bracket" in text
