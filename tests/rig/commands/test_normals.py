"""`rig normals` into a folder that is not there yet."""

import json
from collections.abc import Callable
from pathlib import Path

Run = Callable[..., tuple[int, str, str]]


def test_the_folder_of_the_file_is_made_with_it_alone(rig: Run, toy: Path, tmp_path: Path) -> None:
    lamps = {"reason": "a test", "camera": "cam0", "spread": 0.1}
    places = {"0": [0.0, 0.5, 1.0], "1": [0.5, -0.5, 1.0], "2": [-0.5, -0.5, 1.0]}
    (toy / "lamps.json").write_text(json.dumps(lamps | {"places": places}))
    folder = tmp_path / "new" / "folder"
    asked = ("normals", str(toy), str(folder / "normals.exr"))
    code, _, err = rig(*asked, "--white", "9000,0,4,4=90%")
    assert (code, "9000,0,4,4" in err) == (2, True), err
    assert not folder.parent.exists()
    code, _, err = rig(*asked)
    assert code == 0, err
    assert {path.name for path in folder.iterdir()} == {"normals.exr", "normals.png"}
