"""`rig export` on the command line: what it says, writes and refuses."""

import json
from pathlib import Path


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


def test_the_hand_over_folder_and_cameras(rig, scene: Path, tmp_path: Path) -> None:
    code, out, _ = rig("export", str(scene), "--vfx", str(tmp_path / "vfx"))
    assert code == 0
    assert f"begin with {tmp_path / 'vfx' / 'index.html'}" in out
    assert (tmp_path / "vfx" / "scene.usdc").is_file()
    code, out, _ = rig("export", str(scene), "--format", "cameras", "--out", str(tmp_path / "cameras"))
    assert code == 0
    assert "6 views" in out


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
