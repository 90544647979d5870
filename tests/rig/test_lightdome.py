"""docs/lightdome.md, run as it stands: normals, albedo and their errors against the simulator's truth."""

import contextlib
import json
import re
import shlex
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rig as toolkit
from drivers.sim.rigs import simulate
from imaging.optics.lens import rays
from rig.__main__ import main
from tests.conftest import MadeOnce

PAGE = (Path(__file__).parents[2] / "docs" / "lightdome.md").read_text(encoding="utf-8")
LINES = re.findall(r"^```sh\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[0].splitlines()
FINER = 4
"""Rays of the truth along a side of a pixel."""
Run = Callable[..., tuple[int, str, str]]


class Truth(NamedTuple):
    """By pixel: unit normals and albedo [H, W, 3], whether it shows one smooth surface, its height above the
    panel, m, and whether it shows nothing."""

    normals: np.ndarray
    albedo: np.ndarray
    smooth: np.ndarray
    height: np.ndarray
    empty: np.ndarray


@cache
def truth() -> Truth:
    simulated = simulate("dome")
    lens, pose = simulated.mounts[0].optics.lens, simulated.cam_from_world(0, 0)
    x, y = ((np.arange(size * FINER) + 0.5) / FINER for size in (lens.width, lens.height))
    ahead = rays(lens, np.stack(np.meshgrid(x, y), -1)) @ pose[:3, :3]
    eye = -pose[:3, :3].T @ pose[:3, 3]
    scene = simulated.scene_at(0)
    normals, albedo = scene.surfaces(eye, ahead)
    height = -(eye[1] + scene.depth(eye, ahead) * ahead[..., 1])

    def by_pixel(values: np.ndarray) -> np.ndarray:
        parts = values.reshape(lens.height, FINER, lens.width, FINER, -1)
        return parts.transpose(0, 2, 1, 3, 4).reshape(lens.height, lens.width, FINER**2, -1)

    # Lamps' axes: x right, y up, z towards the camera, which looks along the world's y.
    normals, albedo, height = (
        by_pixel(normals[..., [0, 2, 1]] * (1, 1, -1)),
        by_pixel(albedo),
        by_pixel(height),
    )
    mean = normals.mean(axis=2)
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    alike = (normals @ mean[..., None]).min(axis=(-1, -2)) > np.cos(np.radians(5))
    smooth = alike & (albedo.max(axis=2) < 1.3 * albedo.min(axis=2)).all(axis=-1)
    empty = np.isnan(normals).all(axis=(-1, -2))
    return Truth(mean, albedo.mean(axis=2), smooth, height.mean(axis=(-1, -2)), empty)


@pytest.fixture(scope="module")
def template(made_once: MadeOnce) -> Path:
    """Folder in which all commands of the page were run."""

    def make(folder: Path) -> None:
        said = folder / "said.txt"
        with contextlib.chdir(folder), said.open("w") as file, contextlib.redirect_stdout(file):
            for line in LINES:
                assert main(shlex.split(line, comments=True)[1:]) == 0, line

    return made_once("lightdome", make)


def test_each_command_names_the_next(template: Path) -> None:
    said = re.findall(r"^Next: (.*)$", (template / "said.txt").read_text(), re.MULTILINE)
    commands = [line.partition("#")[0].partition(" --white")[0].strip() for line in LINES]
    assert said[:2] == commands[1:]


def test_the_normals_of_the_page(template: Path) -> None:
    real, albedo, smooth, height, empty = truth()
    image = toolkit.read_exr(template / "normals.exr")
    normals = np.stack([image.channels[f"normal.{axis}"] for axis in "XYZ"], -1)
    measured, mask = np.stack([image.channels[letter] for letter in "RGB"], -1), image.channels["mask"]
    error = image.channels["sigma.normal"]
    known = mask < 4
    assert image.attributes["rig:units"] == "albedo"

    # Unknown is marked, and nowhere else is anything infinite.
    assert not normals[~known].any()
    assert not measured[~known].any()
    assert np.isinf(error[~known]).all()
    assert np.isfinite(error[known]).all()
    assert np.linalg.norm(normals[known], axis=-1) == pytest.approx(1.0, abs=1e-5)
    assert not known[empty].any()
    pilot = albedo.min(axis=-1) == 1.0
    assert pilot.sum() > 10
    assert not known[pilot].any()
    assert (mask[pilot].astype(int) & 1).all()
    soot = albedo.max(axis=-1) < 1e-4
    assert soot.sum() > 500
    assert not known[soot].any()
    page = " ".join(PAGE.split())
    shown = np.isfinite(real).all(axis=-1) & ~pilot & ~soot
    assert round(100 * known[shown].mean()) == 97
    assert "97 % of what the camera sees" in page

    # Normals and albedo are those of the simulator, and normals as exact as they are said to be.
    angle = np.degrees(2 * np.arcsin(np.linalg.norm(normals - real, axis=-1) / 2))
    plane, relief = known & smooth & (height < 0.0025), known & smooth & (height > 0.0025)
    assert min(plane.sum(), relief.sum()) > 4000
    for place, most in ((plane, 0.4), (relief, 0.7)):
        assert np.median(angle[place]) < most
        assert f"below {most}" in page
    off = np.abs(measured / albedo - 1)[known & smooth]
    assert (np.median(off, axis=0) < 0.015).all()
    assert "below 1.5 % in each colour" in page
    within = (angle < 2 * error)[plane].mean()
    assert 0.94 < within < 0.985
    assert "95 % of the normals are within two standard errors" in page
    risen = (angle < 2 * error)[relief].mean()  # under lamps that are nearer than the errors have it
    assert 0.4 < risen < 0.6
    assert "but only about half of those on what rises from it" in page


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        ({"brightness": {"5": 1.3}}, 0, "The lamp of frame 5 has "),
        (
            {"places": {"0": [1, 0, 0.4], "1": [0, 1, 0.4]}},
            2,
            "states no lamp for frame 2, 3, 4, 5, 6, 7 and more",
        ),
        ({"places": {str(frame): None for frame in range(25)}}, 2, "has 0 lamps"),
        ({"across": None}, 2, "of the lit pixels fit a Lambertian surface: check the order"),
        ({"places": {"3": [0, 0, 0]}}, 2, "a lamp stands at 0, 0, 0"),
    ],
)
def test_lamps_that_are_not_those_of_the_shots(
    template: Path, rig: Run, tmp_path: Path, change: dict, code: int, said: str
) -> None:
    shutil.copytree(template / "S", tmp_path / "S")
    path = tmp_path / "S" / "lamps.json"
    record = json.loads(path.read_text())
    if "brightness" in change:
        change = {"brightness": record["brightness"] | {"5": 1.3 * record["brightness"]["5"]}}
    path.write_text(json.dumps(record | change))
    out = tmp_path / "normals.exr"
    result, lines, errors = rig("normals", str(tmp_path / "S"), str(out))
    assert result == code, errors
    assert said in lines + errors
    assert out.exists() == (code == 0)
    if code:
        assert errors.count("\n") == 1
    else:  # one wrong lamp among many bends nothing
        image = toolkit.read_exr(out)
        real = truth()
        plane = (image.channels["mask"] < 4) & real.smooth & (real.height < 0.0025)
        normals = np.stack([image.channels[f"normal.{axis}"] for axis in "XYZ"], -1)
        angle = np.degrees(2 * np.arcsin(np.linalg.norm(normals - real.normals, axis=-1) / 2))
        assert np.median(angle[plane]) < 0.4
        assert image.attributes["rig:units"].startswith("albedo times one factor")


def test_what_cannot_be_used_is_refused_in_a_sentence(template: Path, rig: Run, tmp_path: Path) -> None:
    session = tmp_path / "S"
    shutil.copytree(template / "S", session)
    for arguments, said in (
        (("sky.png",), "is no EXR file"),
        (("n.exr", "--white", "0,0,5,5=90%"), "no albedo is measured in the patch 0,0,5,5"),
        (("n.exr", "--white", "0,0,5,5"), "write a patch as 250,170,12,12=90%"),
        (("n.exr", "--white", "0,0,0,5=90%"), "a patch has pixels"),
    ):
        code, _, errors = rig("normals", str(session), str(tmp_path / arguments[0]), *arguments[1:])
        assert (code, said in errors) == (2, True), errors
    (session / "lamps.json").unlink()
    code, _, errors = rig("normals", str(session), str(tmp_path / "n.exr"))
    assert (code, "has no lamps.json: write one" in errors) == (2, True)
    assert not list(tmp_path.glob("n.*"))
