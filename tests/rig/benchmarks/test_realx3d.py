"""`rig bench realx3d` on the painted wall, photographed in the dark."""

import json

import numpy as np
import pytest

from imaging.session.session import Session
from recon.decide.presets import QUALITIES, Quality
from tests.rig.benchmarks.realx3d_scene import realx3d_scene


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=80, gaussians=300, width=64))


def test_dark_photographs_are_measured_against_clean_ones_and_the_laser(rig, tmp_path):
    scene = realx3d_scene(tmp_path / "RealX3D")
    place = tmp_path / "out"
    code, out, err = rig(
        "bench", "realx3d", str(scene.parent), "--out", str(place), "--quality", "draft", "--json"
    )
    assert (code, err) == (0, "")
    result = json.loads(out)
    figures = result["scenes"]["Wall"]
    # three stops are missing from the first, and the exposure restores them
    assert figures["psnr"] < 12
    assert figures["psnr_exposed"] > 22
    assert figures["ssim_exposed"] > figures["ssim"]
    # three metres away; a laser taken in units of the model would be a metre off
    assert figures["depth_l1"] < 0.3
    assert any("NTIRE 2026" in row for row in result["published"])
    session = Session.open(place / "Wall" / "session")
    split = session.split()
    assert (len(split.train), len(split.test)) == (6, 3)
    model = json.loads((session.folder / "reconstructions" / "draft-0" / "model.json").read_text())
    assert sum(view["use"] == "training" for view in model["views"]) == 6
    # links to another disk, which has neither the laser nor the session
    (tmp_path / "disk").mkdir()
    for folder in (scene, session.folder / "reconstructions"):
        folder.symlink_to(folder.rename(tmp_path / "disk" / folder.name))
    (place / "Wall" / "draft-0.json").unlink()
    _, out, err = rig("bench", "realx3d", str(scene), "--out", str(place), "--quality", "draft", "--json")
    assert (json.loads(out)["scenes"]["Wall"], err) == (figures, "")


def test_without_a_laser_there_is_no_depth(rig, tmp_path):
    scene = realx3d_scene(tmp_path / "RealX3D")
    np.save(tmp_path / "RealX3D" / "pointclouds" / "Wall" / "colmap2world.npy", np.zeros((4, 4)))
    arguments = ("bench", "realx3d", str(scene), "--out", str(tmp_path / "out"), "--quality", "draft")
    code, _, err = rig(*arguments)
    assert (code, "is not a similarity" in err) == (2, True)
    (tmp_path / "RealX3D" / "pointclouds").rename(tmp_path / "elsewhere")
    code, out, _ = rig(*arguments, "--json")  # the scene is kept, so this only measures
    assert (code, "depth_l1" in json.loads(out)["mean"]) == (0, False)
