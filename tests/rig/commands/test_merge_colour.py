"""Colours of `rig merge`: other spaces, cameras of unknown colour, and mono cameras."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from capture.simulated import capture_simulated
from imaging.colour.spaces import space_from_rec709
from imaging.files.exr.reading import read_exr

Run = Callable[..., tuple[int, str, str]]


def test_another_space_is_the_same_light_and_says_so(rig: Run, toy: Path, tmp_path: Path) -> None:
    chosen = ("--frame", "0", "--camera", "cam0", "--json")
    images = []
    for space in ("rec709", "acescg"):
        code, out, _ = rig("merge", str(toy), str(tmp_path / "M"), "--space", space, *chosen)
        (entry,) = json.loads(out)["files"]
        assert code == 0
        assert entry["reused"] is False
        images.append(read_exr(Path(entry["file"])))
    plain, wide = images
    assert wide.attributes["rig:colour"] == "ACEScg"
    assert wide.attributes["colorInteropID"] == "lin_ap1_scene"
    assert plain.attributes["colorInteropID"] == "lin_rec709_scene"
    expected = plain.rgb() @ space_from_rec709("acescg").T
    stored = np.stack([wide.channels[letter] for letter in "RGB"], axis=-1)
    assert np.abs(stored - expected).max() < 1e-5 * expected.max()
    # Noise is mixed from the photosites once, and not from channels that share theirs.
    sigma = np.stack([wide.channels[f"sigma.{letter}"] for letter in "RGB"], axis=-1)
    apart = np.stack([plain.channels[f"sigma.{letter}"] for letter in "RGB"], axis=-1) ** 2
    assert not np.allclose(sigma**2, apart @ (space_from_rec709("acescg") ** 2).T, rtol=1e-3)
    assert (sigma > 0).all()


def test_a_camera_of_unknown_colour_has_no_other_space(rig: Run, toy: Path, tmp_path: Path) -> None:
    (toy / "calibration" / "calibration.json").unlink()
    code, _, err = rig("merge", str(toy), str(tmp_path / "M"), "--space", "acescg")
    assert code == 2
    assert "the colour of camera cam0 is not known" in err
    assert not (tmp_path / "M").exists()
    code, out, _ = rig("merge", str(toy), str(tmp_path / "M"), "--camera", "cam0", "--frame", "0")
    assert code == 0
    assert "The colours of cam0 are camera RGB, and no Rec.709: run `rig calibrate" in out
    assert "and merge the session again for Rec.709" in out
    chosen = ("--camera", "cam0", "--frame", "0", "--json")
    entry = json.loads(rig("merge", str(toy), str(tmp_path / "M"), *chosen)[1])
    assert (entry["camera_rgb"], entry["files"][0]["reused"]) == (["cam0"], True)


def test_a_mono_camera_sees_grey_in_every_space(rig: Run, tmp_path: Path) -> None:
    session = tmp_path / "S"
    capture_simulated("toy-mono", session, bracket=(0.0,), frames=1, seed=3)
    for space, name, reused in (
        ("acescg", "ACEScg", False),
        ("rec709", "Rec.709", False),
        ("rec709", "Rec.709", True),
    ):
        code, out, err = rig("merge", str(session), str(tmp_path / "M"), "--space", space, "--json")
        assert code == 0, err
        data = json.loads(out)
        assert (data["camera_rgb"], {one["reused"] for one in data["files"]}) == ([], {reused})
        image = read_exr(Path(data["files"][0]["file"]))
        assert image.attributes["rig:colour"] == name
        np.testing.assert_allclose(image.channels["R"], image.channels["B"], rtol=1e-4)
