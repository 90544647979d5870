"""`rig export` on the command line: what it says, writes and refuses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR

from imaging.progress import unreported
from imaging.session.calibration import Response
from imaging.session.paths import find_reconstruction
from recon.exports.hand_over import hand_over
from recon.exports.plates import write_plates
from recon.result.model import DisplayValues, read_own_calibration
from recon.result.scene import open_scene


def test_a_file_and_what_it_lost(rig, scene: Path, tmp_path: Path) -> None:
    code, out, err = rig("export", str(scene), "--out", str(tmp_path / "scene.sog"))
    assert (code, err) == (0, "")
    first, light, lost, *_ = out.splitlines()
    assert first.startswith(f"{tmp_path / 'scene.sog'}: ")
    assert "sRGB codes, of light up to 25 times white" in first
    assert "its light is that of the scene times" in light
    assert lost.startswith("lost: ")
    assert "stops" in lost
    code, out, _ = rig("export", str(scene), "--out", str(tmp_path / "scene.usda"), "--json")
    data = json.loads(out)
    assert code == 0
    assert data["format"] == "usd"
    assert data["loss"]["pixel_p99"] < 0.01
    assert data["files"] == [str(tmp_path / "scene.usda")]


def test_a_name_of_no_format_is_refused_before_the_scene_is_opened(
    rig, scene: Path, tmp_path: Path, monkeypatch
) -> None:
    for module in ("recon.result.scene", "recon.exports.export"):
        monkeypatch.setattr(f"{module}.open_scene", lambda folder: [][1])
    code, out, err = rig("export", str(scene), "--out", str(tmp_path / "scene.abc"))
    assert (code, out) == (2, "")
    assert "scene.abc does not name a format by its suffix" in err


def test_the_hand_over_folder_and_cameras(rig, scene: Path, tmp_path: Path) -> None:
    code, out, _ = rig("export", str(scene), "--vfx", str(tmp_path / "vfx"))
    assert code == 0
    assert f"begin with {tmp_path / 'vfx' / 'index.html'}" in out
    assert (tmp_path / "vfx" / "scene.usdc").is_file()
    plate, render = (
        OpenEXR.File(str(tmp_path / "vfx" / folder / "cam0.0000.exr"), header_only=True).header()
        for folder in ("plates", "renders")
    )
    for name in ("worldToCamera", "worldToNDC", "pinholeFocalLength"):
        assert np.allclose(plate[name], render[name], rtol=1e-5, atol=1e-5)
    code, out, _ = rig("export", str(scene), "--format", "cameras", "--out", str(tmp_path / "cameras"))
    assert code == 0
    assert "6 views" in out


def test_plates_that_are_not_as_bright_as_their_renders_are_said(scene: Path, tmp_path: Path) -> None:
    """Display values as they are have no exposure, but plates of photographs do."""
    opened = open_scene(find_reconstruction(scene))
    scales = read_own_calibration(opened.folder).exposure_scale.values()
    for factor, said in ((1.0, ()), (4.0, ("plates are up to 2 stops brighter or darker",))):
        display = DisplayValues(response=Response(kind="srgb", evidence=""), k=factor * max(scales))
        shown = replace(opened, record=opened.record.model_copy(update={"display": display}))
        notes = write_plates(tmp_path / f"{factor}", shown, 1.0, unreported).notes
        assert len(notes) == len(said)
        assert all(part in note for part, note in zip(said, notes, strict=True))


def test_renders_are_as_large_as_plates_of_which_the_scene_has_another_number_of_rows(
    scene: Path, tmp_path: Path
) -> None:
    """Trained 45 px wide, 64x48 has 33 rows; these enlarged would be 47."""
    opened = open_scene(find_reconstruction(scene))
    views = [view.model_copy(update={"lens": view.lens.resized(45, 33)}) for view in opened.views[:1]]
    small = replace(opened, record=opened.record.model_copy(update={"views": views}))
    handed = hand_over(small, tmp_path / "vfx").folder
    plate, render = (
        OpenEXR.File(str(handed / folder / "cam0.0000.exr"), separate_channels=True)
        for folder in ("plates", "renders")
    )
    assert plate.channels()["R"].pixels.shape == render.channels()["R"].pixels.shape == (48, 64)
    assert np.allclose(plate.header()["worldToNDC"], render.header()["worldToNDC"], rtol=1e-5, atol=1e-5)


def test_albedo_is_counted(rig, scene: Path, tmp_path: Path) -> None:
    code, out, _ = rig("export", str(scene), "--out", str(tmp_path / "scene.ply"), "--linear", "--albedo")
    assert code == 0
    (line,) = [line for line in out.splitlines() if line.startswith("albedo: ")]
    assert "of the Gaussians, standard error" in line or "of no Gaussian" in line
    assert b"property float albedo_sigma" in (tmp_path / "scene.ply").read_bytes()


def test_wrong_usage(rig, scene: Path, tmp_path: Path) -> None:
    for options, words in (
        ([], "ame a file with --out, or a folder with --vfx"),
        (["--vfx", "a", "--out", "b.ply"], "ame a file with --out, or a folder with --vfx"),
        (["--vfx", "a", "--linear"], "--vfx writes its own formats"),
        (["--vfx", "a", "--albedo"], "--albedo out"),
        (["--out", str(tmp_path / "a.sog"), "--albedo"], "--albedo is for linear light"),
        (["--out", str(tmp_path / "a.spz"), "--linear"], "more than a third of a stop"),
        (["--out", str(tmp_path / "a.obj")], "name one with --format"),
    ):
        code, out, err = rig("export", str(scene), *options)
        assert (code, out) == (2, "")
        assert words in err
        assert err.count("\n") == 1
    assert not list(tmp_path.glob("a.*"))
