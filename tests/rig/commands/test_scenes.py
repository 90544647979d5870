"""Several scenes of a session: named by globs, each measured and rendered in its own folder, none lost."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from imaging.files import store
from imaging.files.exr.reading import read_exr

DRAFT = "nh-3dgs-draft"


@pytest.fixture
def two(scene: Path) -> list[str]:
    """Expansion of S/reconstructions/* by a shell: two scenes."""
    shutil.copytree(scene / "reconstructions" / DRAFT, scene / "reconstructions" / "other")
    return sorted(str(path) for path in (scene / "reconstructions").iterdir())


def test_evaluate_measures_every_scene_that_is_named(rig, two: list[str]) -> None:
    for folder in two:
        (Path(folder) / "metrics.json").unlink()
    code, out, err = rig("evaluate", *two)
    assert (code, err) == (0, "")
    assert [line.partition(":")[0] for line in out.splitlines() if "RAW PSNR" in line] == two
    assert all((Path(folder) / "metrics.json").is_file() for folder in two)


def test_scenes_of_a_session_are_compared_at_the_width_of_the_finest(rig, scene: Path) -> None:
    """A coarse one is measured at more pixels than it was trained on; alone, each is as it was trained."""
    coarse, fine = scene / "reconstructions" / "coarse", scene / "reconstructions" / DRAFT
    command = ("reconstruct", str(scene), "--quality", "draft", "--name", "coarse")
    sets = ("--set", "width=32", "--set", "iterations=20", "--set", "gaussians=200")
    code, out, _ = rig(*command, *sets)
    assert code == 0
    assert "dB at 32 px" in out.splitlines()[0]
    assert out.splitlines()[1].endswith(" at 32 px")
    alone = store.read_json(coarse / "metrics.json")
    _, out, _ = rig("evaluate", str(coarse), str(fine))
    assert [line.endswith(" at 64 px") for line in out.splitlines() if "PSNR" in line] == [True, True]
    both = [store.read_json(folder / "metrics.json") for folder in (coarse, fine)]
    assert (alone["width"], [one["width"] for one in both]) == (32, [64, 64])
    assert both[0]["raw_psnr"] != pytest.approx(alone["raw_psnr"], abs=0.01)
    assert len(read_exr(coarse / "renders" / "0001_cam0.exr").rgb()) == 48


def test_a_scene_that_cannot_be_measured_does_not_keep_others_from_it(rig, two: list[str]) -> None:
    (Path(two[0]) / "checkpoint.safetensors").unlink()
    code, out, err = rig("evaluate", *two, "--json")
    data = json.loads(out)
    assert code == 3
    assert [one["reconstruction"] for one in data["scenes"]] == [two[1]]
    assert "1 of 2 scenes could not be evaluated" in err
    assert "checkpoint.safetensors is missing" in err


@pytest.mark.parametrize("count", [1, 2])
def test_render_writes_a_folder_for_each_scene(rig, two: list[str], tmp_path: Path, count: int) -> None:
    out = tmp_path / "renders"
    code, text, err = rig("render", *two[:count], "--out", str(out))
    assert (code, err) == (0, "")
    assert sorted(path.name for path in out.iterdir()) == sorted([DRAFT, "other"][:count])
    for folder in two[:count]:
        name = Path(folder).name
        assert f"{out / name}: 6 views of {folder}, as EXR and PNG" in text
        assert len(list((out / name).glob("*.exr"))) == len(list((out / name).glob("*.png"))) == 6


def test_render_says_which_scene_of_a_session_it_took_and_how_bright_it_is(
    rig, two: list[str], tmp_path: Path
) -> None:
    session = Path(two[0]).parent.parent
    code, out, _ = rig("render", str(session), "--out", str(tmp_path / "out"), "--json")
    (entry,) = json.loads(out)["scenes"]
    assert code == 0
    assert entry["reconstruction"] in two
    exr = read_exr(Path(entry["files"][0]))
    assert exr.attributes["rig:exposureFactor"] == pytest.approx(entry["exposure_factor"], rel=1e-6)
    assert entry["exposure_factor"] == store.read_json(Path(two[0]) / "model.json")["exposure"]


def test_an_exposure_brightens_light_and_pngs_alike(rig, two: list[str], tmp_path: Path) -> None:
    from imaging.files.photo import read_photo

    def rendered(*words: str) -> tuple[np.ndarray, np.ndarray]:
        out = tmp_path / "".join(words or ("plain",))
        assert rig("render", two[0], "--out", str(out), *words)[0] == 0
        exr, png = out / DRAFT / "0000_cam0.exr", out / DRAFT / "0000_cam0.png"
        return read_exr(exr).rgb(), read_photo(png).pixels

    (plain, usual), (faint, dark) = rendered(), rendered("--exposure", "-20")
    exposure = store.read_json(Path(two[0]) / "model.json")["exposure"]
    np.testing.assert_allclose(plain / exposure, faint * 2.0**20, rtol=1e-5)
    assert dark.max() < 0.1 < usual.mean()


def test_pictures_never_land_in_the_folder_of_a_scene(rig, two: list[str], tmp_path: Path) -> None:
    before = sorted(Path(two[0]).parent.rglob("*"))
    for arguments, words in (
        ([*two, "--out", two[1]], "is in the folder of the scene"),
        ([two[0], "--out", str(Path(two[0]).parent)], "is in the folder of the scene"),
        ([two[0], str(tmp_path / "out")], "pictures go to the folder that --out names"),
    ):
        code, out, err = rig("render", *arguments)
        assert (code, out) == (2, "")
        assert words in err
        assert err.count("\n") == 1
    assert sorted(Path(two[0]).parent.rglob("*")) == before


def test_a_scene_file_is_never_taken_for_the_folder_of_its_pictures(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "x.ply").write_bytes(b"ply")
    monkeypatch.chdir(tmp_path)
    code, out, err = rig("render", "x.ply", "--out", ".")
    assert (code, out) == (2, "")
    assert "x.ply is the file of the scene: name another folder with --out" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--probe", "1,2"], "three numbers separated by commas"),
        (["--probe", "-1,2,inf"], "three numbers separated by commas"),
        (["--probe", "1,2,3", "--probe-view", "0000/cam0"], "give only one of them"),
        (["--probe", "1,2,3", "--path", "orbit"], "leave --path"),
        (["--probe-view", "0000/none"], "has no view '0000/none'"),
        (["--start-frame", "7"], "name one by --path"),
        (["--layers", "depth,colour"], "no layer 'colour'"),
        (["--tones", "sepia"], "no tones 'sepia'"),
        (["--path", "orbit:0"], "is not a path"),
        (["--path", "nowhere.csv"], "nowhere.csv is not a path to render"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_a_sentence(
    rig, two: list[str], tmp_path: Path, words: list[str], message: str
) -> None:
    code, out, err = rig("render", two[0], "--out", str(tmp_path / "out"), *words)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_film_for_hdr_screens_says_where_light_ends(rig, two: list[str], tmp_path: Path) -> None:
    arguments = ("--path", "orbit:2", "--width", "32", "--out", str(tmp_path / "out"), "--hdr")
    assert "light is clipped 4 stops above it\n" in rig("render", two[0], *arguments)[1]
    code, out, _ = rig("render", two[0], *arguments, "--video")
    assert code == 0
    assert "orbit.hdr.mp4, orbit.hlg.mp4 and orbit.mp4" in out
    assert "4 stops above it, and in HLG at 1000 cd/m2\n" in out


def test_a_light_probe_says_what_of_it_is_known(rig, two: list[str], tmp_path: Path) -> None:
    arguments = ("--probe=-0.1,0,0", "--width", "32", "--out", str(tmp_path / "out"))
    code, out, _ = rig("render", two[0], *arguments)
    assert code == 0
    assert "% of all directions; the rest of the map is black" in out
    assert {path.name for path in (tmp_path / "out").rglob("*.*")} == {"probe.exr", "probe.png"}


def test_a_file_where_the_pictures_should_go_is_told_at_once(rig, two: list[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    code, _, err = rig("render", two[0], "--out", str(tmp_path / "file"))
    assert code == 2
    assert "a file is in the place of a folder, so remove that or use another name" in err
    assert (tmp_path / "file").read_text() == "mine"


def test_what_is_there_already_is_said_with_its_figures(rig, scene: Path) -> None:
    folder = scene / "reconstructions" / DRAFT
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    code, out, _ = rig("reconstruct", str(scene), "--quality", "draft")
    assert code == 0
    lines = out.splitlines()
    assert lines[0].startswith(f"{folder}: already there, finished on 20")
    assert "RAW PSNR" in lines[1]
    assert lines[-1] == f"Next: rig render {folder}"
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    assert json.loads(rig("reconstruct", str(scene), "--quality", "draft", "--json")[1])["already_there"]


def test_another_quality_is_another_scene_and_the_same_name_is_refused(rig, scene: Path) -> None:
    command = ["reconstruct", str(scene), "--quality", "draft", "--seed", "4"]
    code, out, err = rig(*command)
    assert (code, out) == (2, "")
    assert "trained with seed 0" in err
    assert "--name, or --replace" in err
    code, out, _ = rig(*command, "--replace")
    assert code == 0
    assert f"{scene / 'reconstructions' / DRAFT}: trained in" in out
    assert store.read_json(scene / "reconstructions" / DRAFT / "model.json")["settings"]["seed"] == 4


def test_a_folder_with_spaces_can_be_pasted(rig, scene: Path, tmp_path: Path) -> None:
    spaced = scene.rename(tmp_path / "my scene 名")
    _, out, _ = rig("reconstruct", str(spaced), "--quality", "draft")
    assert out.splitlines()[-1] == f"Next: rig render '{spaced / 'reconstructions' / DRAFT}'"
