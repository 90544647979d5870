"""`rig bench` on small scenes in the layouts of the data sets."""

import json
import shutil
from pathlib import Path

import pytest

from imaging.session.session import Session
from recon.decide.presets import QUALITIES, Quality
from tests.rig.benchmarks.painted_wall import plenoxels_scene, rawnerf_scene


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=80, gaussians=300, width=64))


def bench(rig, *arguments):
    code, out, err = rig("bench", *map(str, arguments), "--quality", "draft", "--json")
    return code, json.loads(out) if out.startswith("{") else None, err


def test_rawnerf_is_measured_against_the_clean_mosaic_once(rig, tmp_path, monkeypatch):
    scene = rawnerf_scene(tmp_path / "data" / "wall")
    (tmp_path / "data" / "notes").mkdir()
    code, result, err = bench(rig, "rawnerf", tmp_path / "data", "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    figures = result["scenes"]["wall"]
    assert figures == result["mean"]
    # a grey wall has 34 dB, one whose exposure is taken for that of the burst 17
    assert figures["raw_psnr"] > 42
    assert figures["rgb_psnr"] > 25
    assert figures["rgb_ssim"] > 0.8
    assert result["published"]["Raw3DGS (Li et al., arXiv 2406.08300)"]["raw_psnr"] == 59.49
    place = tmp_path / "out" / "wall"
    scenes = place / "session" / "reconstructions"
    scenes.symlink_to(scenes.rename(tmp_path / "disk"))
    (place / "draft-0.json").unlink()
    code, again, err = bench(rig, "rawnerf", scene, "--out", tmp_path / "out")
    assert (code, again["scenes"], err) == (0, result["scenes"], "")
    monkeypatch.setattr("rig.benchmarks.protocol.reconstruct", None)  # nothing is trained again
    code, again, _ = bench(rig, "rawnerf", scene, "--out", tmp_path / "out")
    assert (code, again["scenes"]) == (0, result["scenes"])
    code, out, _ = rig("bench", "rawnerf", str(scene), "--out", str(tmp_path / "out"), "--quality", "draft")
    assert code == 0
    for word in (
        "wall",
        "mean",
        "RAW dB",
        f"{figures['raw_psnr']:.2f}",
        "published",
        "59.49",
        "clean mosaic",
    ):
        assert word in out


def test_a_scene_that_fails_is_told_and_the_others_are_measured(rig, tmp_path):
    rawnerf_scene(tmp_path / "data" / "a")
    shutil.copytree(tmp_path / "data" / "a", tmp_path / "data" / "b")
    (tmp_path / "data" / "b" / "raw" / "train" / "IMG_3.dng").unlink()
    code, result, err = bench(rig, "rawnerf", tmp_path / "data", "--views", "4", "--out", tmp_path / "out")
    assert code == 3
    assert list(result["scenes"]) == ["a"]
    assert "1 of 2 scenes could not be measured" in err
    assert "IMG_3.dng" in result["failed"]["b"]
    model = json.loads((tmp_path / "out/a/session/reconstructions/draft-0-4-views/model.json").read_text())
    assert sum(view["use"] == "training" for view in model["views"]) == 4


def test_hdr_plenoxels_is_measured_on_halves_that_nothing_was_fitted_to(rig, tmp_path):
    scene = plenoxels_scene(tmp_path / "wall")
    code, result, err = bench(rig, "hdr-plenoxels", scene, "--out", tmp_path / "out")
    assert (code, err) == (0, "")
    split = Session.open(tmp_path / "out" / "wall" / "session").split()
    assert (len(split.train), len(split.test)) == (6, 3)
    assert result["mean"]["psnr"] > 22


def test_folders_that_are_no_scenes_are_refused(rig, tmp_path):
    for protocol, name in (
        ("rawnerf", "RawNeRF"),
        ("hdr-nerf", "HDR-NeRF"),
        ("hdr-plenoxels", "HDR-Plenoxels"),
    ):
        code, _, err = rig("bench", protocol, str(tmp_path))
        assert code == 2
        assert f"is not a scene of {name} and contains none" in err
    code, _, err = rig("bench", "rawnerf", str(tmp_path / "nowhere"))
    assert (code, "is not a folder" in err) == (2, True)
    assert list(Path(tmp_path).iterdir()) == []
