"""Layers as pictures: what their legends say of a scene, from its first step to its last."""

import json
from pathlib import Path
from types import SimpleNamespace

from rig.view.pictures.layers import legend_of


def test_the_unit_is_that_of_the_calibration_once_it_is_there(toy_template: Path, tmp_path: Path) -> None:
    scene = SimpleNamespace(folder=tmp_path, record=SimpleNamespace(world=SimpleNamespace(unit=2.0)))
    assert legend_of("depth", scene).endswith(" units away")  # while it is trained
    record = json.loads((toy_template / "calibration" / "calibration.json").read_text())
    (tmp_path / "calibration.json").write_text(json.dumps(record | {"unit": "m"}))
    assert legend_of("depth", scene).endswith(" m away")
