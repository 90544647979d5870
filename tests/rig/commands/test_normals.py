"""`rig normals`: into a folder that is not there yet, and of pictures that it cannot use."""

import json
from collections.abc import Callable
from pathlib import Path

from imaging.session.calibration import read_calibration
from rig.terminal.calibration_result import cameras_result

Run = Callable[..., tuple[int, str, str]]


def write_lamps(session: Path) -> None:
    lamps = {"reason": "a test", "camera": "cam0", "spread": 0.1}
    places = {"0": [0.0, 0.5, 1.0], "1": [0.5, -0.5, 1.0], "2": [-0.5, -0.5, 1.0]}
    (session / "lamps.json").write_text(json.dumps(lamps | {"places": places}))


def test_the_folder_of_the_file_is_made_with_it_alone(rig: Run, toy: Path, tmp_path: Path) -> None:
    write_lamps(toy)
    folder = tmp_path / "new" / "folder"
    asked = ("normals", str(toy), str(folder / "normals.exr"))
    code, _, err = rig(*asked, "--white", "9000,0,4,4=90%")
    assert (code, "9000,0,4,4" in err) == (2, True), err
    assert not folder.parent.exists()
    code, _, err = rig(*asked)
    assert code == 0, err
    assert {path.name for path in folder.iterdir()} == {"normals.exr", "normals.png"}


def test_linear_exr_is_refused_and_not_sent_here(rig: Run, toy: Path, tmp_path: Path) -> None:
    write_lamps(toy)
    assert any("rig normals" in line for line in cameras_result(toy, read_calibration(toy)).lines)
    path = toy / "session.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    for camera in record["cameras"]:
        camera["kind"] = "hdr"
    path.write_text(json.dumps(record), encoding="utf-8")
    code, _, err = rig("normals", str(toy), str(tmp_path / "normals.exr"))
    assert (code, "holds linear EXR or HDR pictures, whose noise is not known" in err) == (2, True), err
    assert "rig calibrate" not in err
    assert not any("rig normals" in line for line in cameras_result(toy, read_calibration(toy)).lines)
