"""`import rig`: every name it promises is there, and is what it says."""

import inspect
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import rig
from imaging.colour.spaces import srgb_encode


@pytest.mark.parametrize("name", rig.__all__)
def test_every_public_name_resolves_and_is_documented(name: str) -> None:
    value = getattr(rig, name)
    assert value.__doc__
    assert name in dir(rig)


def test_names_are_those_of_their_stages() -> None:
    from capture.check.check import check
    from imaging.errors import RigError

    assert rig.check is check
    assert rig.RigError is RigError


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="frobnicate"):
        rig.frobnicate  # noqa: B018


def test_the_readme_renders_a_new_pose_from_python(toy: Path, tmp_path: Path, monkeypatch) -> None:
    readme = (Path(__file__).parents[2] / "README.md").read_text()
    section = readme.partition("## From Python\n")[2].partition("\n## ")[0]
    code = "\n".join(line[4:] for line in section.splitlines() if line.startswith("    ") or not line)
    toy.rename(tmp_path / "S")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(code, names)
    light, scene = names["light"], names["scene"]
    shown = np.asarray(Image.open("new.png"), np.float64)
    expected = 255 * srgb_encode(np.clip(light.astype(np.float64) * scene.exposure * 4, 0, 1))
    assert np.abs(shown - expected).max() <= 0.51
    assert np.array_equal(rig.read_exr("new.exr").rgb(), light * np.float32(scene.exposure))
    assert not np.array_equal(light, scene.render(scene.views[0]))


MISSING: dict[str, Callable[[str], object]] = {
    "calibrate": lambda path: rig.calibrate(path),
    "calibration_report": lambda path: rig.calibration_report(path),
    "check": lambda path: rig.check(path),
    "evaluate": lambda path: rig.evaluate(path),
    "import_photos": lambda path: rig.import_photos(path, path + "-out"),
    "merge": lambda path: rig.merge(path, path + "-out"),
    "open_scene": lambda path: rig.open_scene(path),
    "read_calibration": lambda path: rig.read_calibration(path),
    "read_exr": lambda path: rig.read_exr(path),
    "read_photo": lambda path: rig.read_photo(path),
    "read_raw": lambda path: rig.read_raw(path),
    "read_rig_file": lambda path: rig.read_rig_file(path),
    "reconstruct": lambda path: rig.reconstruct(path),
    "reconstruction_report": lambda path: rig.reconstruction_report(path),
    "render": lambda path: rig.render(path, path + "-out"),
    "repair": lambda path: rig.repair(path),
    "Session": lambda path: rig.Session.open(path),
    "trade_sweep": lambda path: rig.trade_sweep(path, budget=1.0),
    "trade_report": lambda path: rig.trade_report(path),
}


@pytest.mark.parametrize("name", MISSING)
def test_a_path_may_be_text_and_one_that_is_missing_is_an_error_of_rig(name: str, tmp_path: Path) -> None:
    with pytest.raises(rig.RigError, match="nosuch"):
        MISSING[name](str(tmp_path / "nosuch"))
    assert not list(tmp_path.iterdir())


def test_results_are_written_where_text_says(scene: Path, tmp_path: Path) -> None:
    merged = rig.merge(str(scene), str(tmp_path / "merged"), frame=0)
    assert merged.calibration == rig.read_calibration(str(scene))
    assert all(view.file.is_file() for view in merged.views)
    rig.write_exr(str(tmp_path / "one.exr"), np.ones((2, 2, 3), np.float32))
    raw = rig.read_raw(str(next(scene.rglob("*.dng"))))
    rig.write_dng(str(tmp_path / "one.dng"), raw)
    assert np.array_equal(rig.read_raw(tmp_path / "one.dng").pixels, raw.pixels)
    folder = str(scene / "reconstructions" / "nh-3dgs-draft")
    assert all(path.is_file() for path in rig.render(folder, str(tmp_path / "out")))
    assert rig.evaluate(folder).gaussians == len(rig.open_scene(folder).gaussians)


def unheard(message: str, done: int, total: int) -> None:
    pytest.fail(f"{message} began before the disk was tried")


TRIED: dict[str, Callable[[Path, Path], object]] = {
    "calibration": lambda session, out: rig.calibrate(session, on_progress=unheard),
    "trade": lambda session, out: rig.trade_sweep(session, budget=1.0, on_progress=unheard),
    "merged": lambda session, out: rig.merge(session, out, on_progress=unheard),
    "renders": lambda session, out: rig.render(
        session / "reconstructions" / "nh-3dgs-draft", out, on_progress=unheard
    ),
}


@pytest.mark.parametrize("name", TRIED)
def test_whether_results_can_be_written_is_tried_before_the_work(name: str, scene: Path) -> None:
    target = scene / name
    if target.exists():
        shutil.rmtree(target)
    target.write_text("in the way")
    with pytest.raises(rig.StorageError, match="a file is in the place of a folder"):
        TRIED[name](scene, target)
    assert target.read_text() == "in the way"


FUNCTIONS = [name for name in rig.__all__ if inspect.isfunction(getattr(rig, name))]
WRONG = (5, None, 2.5, b"text", object(), np.zeros(3), [], {})
"""Value of no type that a path, a rig, tensors or RAW have."""


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name != "find_cameras"])
@pytest.mark.parametrize("value", WRONG, ids=lambda value: type(value).__name__)
def test_arguments_of_a_wrong_type_are_errors_of_rig(
    name: str, value: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    function = getattr(rig, name)
    needed = [one for one in inspect.signature(function).parameters.values() if one.default is one.empty]
    plain = [value for one in needed if one.kind is not one.KEYWORD_ONLY]
    named = {one.name: value for one in needed if one.kind is one.KEYWORD_ONLY}
    with pytest.raises(rig.RigError):
        function(*plain, **named)
    assert not list(tmp_path.iterdir())


OPTIONS: dict[str, Callable[[rig.Scene, Path], object]] = {
    "layers as text": lambda scene, out: rig.render(scene, out, layers="depth"),
    "a layer that is none": lambda scene, out: rig.render(scene, out, layers=("colour",)),
    "views as text": lambda scene, out: rig.render(scene, out, views="0000/cam0"),
    "stops as a number": lambda scene, out: rig.render(scene, out, stops=2.0),
    "width as text": lambda scene, out: rig.render(scene, out, width="640"),
    "a space that is none": lambda scene, out: rig.render(scene, out, space="srgb"),
    "a path of a number": lambda scene, out: rig.render(scene, out, path=3),
    "a format that is none": lambda scene, out: rig.export(scene, out / "a", "obj"),
    "linear as text": lambda scene, out: rig.export(scene, out / "a.ply", linear="yes"),
    "exposure as text": lambda scene, out: rig.hand_over(scene, out, exposure="bright"),
    "a camera of a number": lambda scene, out: scene.render(0),
    "no camera": lambda scene, out: scene.render(None),
    "an exposure of text": lambda scene, out: scene.at("bright"),
    "a picture of no camera": lambda scene, out: scene.at(0.0, 3),
    "a frame of text": lambda scene, out: rig.merge(scene, out, frame="first"),
    "arrays for tensors": lambda scene, out: rig.rasterize(
        *(np.zeros((1, size), np.float32) for size in (3, 4, 3)),
        np.zeros(1, np.float32),
        np.zeros((1, 3), np.float32),
        scene.views[0].splat_camera,
    ),
    "a view for a camera": lambda scene, out: rig.rasterize(
        *(torch.ones(1, size) for size in (3, 4, 3)), torch.ones(1), torch.ones(1, 3), scene.views[0]
    ),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_options_of_a_wrong_type_are_errors_of_rig(name: str, scene_template: Path, tmp_path: Path) -> None:
    opened = rig.open_scene(scene_template)
    with pytest.raises(rig.RigError):
        OPTIONS[name](opened, tmp_path / "out")
    assert not list(tmp_path.iterdir())
