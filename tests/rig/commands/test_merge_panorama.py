"""`rig merge --panorama` of what is no panorama, or a part of one: a sentence, or right light."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.exports.panorama import laying, panorama, standpoint
from calib.exports.panorama.sun import ClippedRegion
from capture.simulated import capture_simulated
from imaging.files import store
from imaging.files.exr.reading import read_exr
from imaging.merge.picture import CLIPPED, DARK, NOTHING
from imaging.plates.merged_view import ViewLight
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.calibration import TURNED, read_calibration
from imaging.session.records import Rung
from rig.terminal.panorama_result import panorama_result
from tests.rig.conftest import calibrated_from_truth

Run = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        ((), "the views stand apart"),
        (("--frame", "0", "--camera", "cam0", "--sun", "1000"), "--sun is an illuminance"),
        (("--frame", "0", "--camera", "cam0", "--width", "101"), "an even number of columns"),
        (("--frame", "7"), "has no view with a pose of that frame or camera"),
    ],
)
def test_what_cannot_be_a_panorama_is_refused_in_a_sentence(
    rig: Run, toy: Path, tmp_path: Path, options: tuple[str, ...], cause: str
) -> None:
    code, out, err = rig("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), *options)
    assert (code, out) == (2, "")
    assert cause in err
    assert err.count("\n") == 1
    assert not list(tmp_path.glob("sky*"))


def test_views_apart_are_merged_with_a_warning_where_nothing_says_how_far_away_things_are(
    rig: Run, toy: Path, tmp_path: Path
) -> None:
    shutil.rmtree(toy / "calibration" / "colmap")
    asked = ("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), "--frame", "0", "--width", "64")
    code, out, err = rig(*asked)
    places = [view.cam_from_world.matrix() for view in read_calibration(toy).views if view.frame == 0]
    one, other = (-motion[:3, :3].T @ motion[:3, 3] for motion in places)
    assert (code, f"differ by at most {np.linalg.norm(one - other):.2g} units" in out) == (0, True), err
    data = json.loads(rig(*asked, "--json")[1])
    assert (data["parallax_degrees"], len(data["warnings"])) == (None, 1)
    data = json.loads(rig(*asked, "--camera", "cam0", "--json")[1])
    assert (data["parallax_degrees"], data["warnings"]) == (0.0, [])


def test_up_is_where_the_file_of_a_view_says_so(
    rig: Run, toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (view, *_) = read_calibration(toy).views
    right, down = view.cam_from_world.matrix()[:2, :3]
    chosen = ("--frame", str(view.frame), "--camera", view.camera, "--width", "64")
    asked = ("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), *chosen)
    for orientation, up in ((1, -down), (6, -right), (8, right)):
        metadata = FrameMetadata(orientation=orientation)
        monkeypatch.setattr(standpoint, "read_metadata", lambda _, metadata=metadata: metadata)
        code, out, err = rig(*asked)
        assert (code, "stand on their side" in out) == (0, False), err
        stated = str(read_exr(tmp_path / "sky.exr").attributes["rig:up"]).split()
        np.testing.assert_allclose([float(part) for part in stated], up, atol=1e-6)
    monkeypatch.setattr(panorama, "on_their_side", lambda _: True)
    assert "up and down of the panorama may be exchanged" in rig(*asked)[1]


def test_camera_rgb_is_said(rig: Run, toy: Path, tmp_path: Path) -> None:
    path = toy / "calibration" / "calibration.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    for camera in record["cameras"]:
        camera["camera_from_rec709"] = None
    path.write_text(json.dumps(record), encoding="utf-8")
    asked = ("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), "--frame", "0", "--camera", "cam0")
    code, out, err = rig(*asked, "--width", "64")
    assert code == 0, err
    assert "The colours of cam0 are camera RGB, and no Rec.709: run `rig calibrate" in out
    assert "and merge the session again for Rec.709" in out
    assert "`rig merge" not in out  # which, without the frame and the camera, would be refused
    assert json.loads(rig(*asked, "--width", "64", "--json")[1])["camera_rgb"] == ["cam0"]


def test_the_brightest_of_many_saturated_places_are_named(
    rig: Run, toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    regions = [ClippedRegion(step, 0.0, 1e-5, 1.0) for step in range(500)]
    nothing = np.zeros((32, 64), bool)
    monkeypatch.setattr(panorama, "clipped_regions", lambda *_: (regions, nothing))
    chosen = ("--frame", "0", "--camera", "cam0", "--width", "64")
    code, out, err = rig("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), *chosen)
    assert code == 0, err
    assert out.count("A disc of") == 3
    assert "497 dimmer places besides" in out
    assert "--sun" not in out
    made = panorama.merge_panorama(toy, tmp_path / "sky.exr", frame=0, camera="cam0", width=64)
    said = panorama_result(toy, replace(made, absolute=True), "rec709").lines
    assert any("give --sun the lux of a card that faces the first" in line for line in said)


def test_the_file_and_the_options_of_a_panorama_belong_to_it(rig: Run, toy: Path, tmp_path: Path) -> None:
    code, _, err = rig("merge", str(toy), "--panorama", str(tmp_path / "sky.jpg"))
    assert (code, "is no EXR file" in err) == (2, True)
    code, _, err = rig("merge", str(toy), str(tmp_path / "M"), "--sun", "4")
    assert (code, "are for --panorama" in err) == (2, True)
    (toy / "calibration" / "calibration.json").unlink()
    code, _, err = rig("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"))
    assert (code, "run `rig calibrate` first" in err) == (2, True)


def test_one_view_of_one_exposure_shows_its_part_and_no_seam(rig: Run, tmp_path: Path) -> None:
    session = tmp_path / "S"
    capture_simulated("toy", session, bracket=(0.0,), seed=3)
    calibrated_from_truth(session)
    chosen = ("--frame", "1", "--camera", "cam1", "--exr", "half", "--json")
    code, out, _ = rig("merge", str(session), "--panorama", str(tmp_path / "sky.exr"), *chosen)
    data = json.loads(out)
    assert code == 0
    assert (data["views"], data["seams"], data["seam_stops"]) == (1, [], None)
    sky = read_exr(tmp_path / "sky.exr")
    mask = sky.channels["mask"]
    assert (sky.rgb() == sky.rgb().astype(np.float16)).all()
    assert 0.01 < data["known"] < 0.2
    assert ((mask == NOTHING) == (sky.channels["A"] == 0)).all()
    truth = read_exr(session / "truth" / "0001" / "cam1.exr").rgb()
    light = sky.rgb()[mask == 0]
    assert np.log2(np.median(light) / np.median(truth)) == pytest.approx(0, abs=0.5)


@pytest.mark.parametrize(
    ("bands", "fix"),
    [
        ({("cam1", frame): "650nm" for frame in range(3)}, "name one --camera (cam0, cam1), or merge"),
        ({("cam0", 1): "650nm"}, "merge its bands without --panorama"),
    ],
    ids=["of a camera", "of a frame"],
)
def test_views_of_several_bands_are_not_mixed(
    rig: Run, toy: Path, tmp_path: Path, bands: dict[tuple[str, int], str], fix: str
) -> None:
    shots = [json.loads(line) for line in (toy / "shots.jsonl").read_text().splitlines()]
    for shot in shots:
        shot["band"] = bands.get((shot["camera"], shot["frame"]))
    (toy / "shots.jsonl").write_text("".join(json.dumps(shot) + "\n" for shot in shots))
    path = toy / "calibration" / "calibration.json"
    record = json.loads(path.read_text()) | {"shots_sha256": store.sha256(toy / "shots.jsonl")}
    path.write_text(json.dumps(record))
    code, _, err = rig("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"))
    assert (code, "was shot through filters" in err, fix in err) == (2, True, True)
    one = ("--camera", "cam1", "--frame", "0", "--width", "64")
    code, _, err = rig("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), *one)
    assert code == 0, err


def test_texels_that_are_wider_than_the_views_are_said(rig: Run, toy: Path, tmp_path: Path) -> None:
    asked = ("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), "--frame", "0", "--camera", "cam0")
    code, _, err = rig(*asked, "--width", "16")
    assert (code, "--width 16 is too coarse for these views" in err) == (2, True), err
    assert rig(*asked, "--width", "32")[0] == 0


@pytest.mark.parametrize("bit", [CLIPPED, DARK], ids=["saturated", "black"])
def test_where_no_exposure_measures_anything_it_says_so(
    rig: Run, toy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bit: int
) -> None:
    real = laying.view_light

    def blind(*given: object) -> ViewLight:
        merged = real(*given)
        mask = np.full_like(merged.picture.mask, bit)
        return replace(merged, picture=replace(merged.picture, mask=mask))

    monkeypatch.setattr(laying, "view_light", blind)
    one = ("--frame", "0", "--camera", "cam0")
    code, _, err = rig("merge", str(toy), "--panorama", str(tmp_path / "sky.exr"), *one)
    assert (code, "no exposure of any view measures light" in err) == (2, True)


def test_a_session_from_one_place_is_not_reconstructed(rig: Run, toy: Path) -> None:
    path = toy / "calibration" / "calibration.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    record["rungs"].append(Rung(name=TURNED, taken=True, reason="one place").model_dump(mode="json"))
    path.write_text(json.dumps(record), encoding="utf-8")
    code, _, err = rig("reconstruct", str(toy))
    assert (code, "was taken from one place" in err) == (2, True)
