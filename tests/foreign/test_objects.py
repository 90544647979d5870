"""Foreign objects before a light probe, seen from half around, from poses that are given: RAW and JPEG."""

from pathlib import Path

import numpy as np
import pytest

from imaging.files import store
from rig.__main__ import main

from . import judge, subjects
from .folder import Body, photograph, tell_poses
from .taken import Taken, all_measured

pytest.importorskip("mitsuba")


def imported(folder: Path, body: Body, times: tuple[tuple[float, ...], ...], developed: bool) -> Taken:
    """Photographed, imported with poses, and calibrated but for them."""
    scene = subjects.objects(views=14, width=160, samples=4, traced=64, span=160.0)
    light = scene.light()
    shots = photograph(folder / "photos", light, body, times, developed=developed)
    tell_poses(shots, scene.poses, scene.focal, (scene.width, scene.height), scene.surface_points())
    session = folder / "S"
    exits = {"import": main(["import", str(shots.folder), str(session)])}
    exits["calibrate"] = main(["calibrate", str(session), "--only", "response"])
    judge.tell_truth(session, light, scene.poses, shots, developed=developed)
    return Taken(scene, light, shots, session, exits)


def trained(taken: Taken, *options: str) -> Taken:
    """The same, reconstructed and evaluated."""
    few = ["--quality", "draft", "--set", "iterations=200", *options, "--name", "scene"]
    with all_measured():
        taken.exits["reconstruct"] = main(["reconstruct", str(taken.session), *few])
    return taken


@pytest.fixture(scope="module")
def brackets(tmp_path_factory: pytest.TempPathFactory) -> Taken:
    body = Body(12, well=9_000.0, black=256, seed=3)
    taken = imported(tmp_path_factory.mktemp("raw"), body, ((1 / 125, 1 / 8, 2.0),), False)
    return trained(taken, "--set", "environment=1")


@pytest.fixture(scope="module")
def jpegs(tmp_path_factory: pytest.TempPathFactory) -> Taken:
    times = ((1 / 125, 1 / 30, 1 / 8, 1 / 2, 2.0),)
    return imported(tmp_path_factory.mktemp("jpeg"), Body(seed=4, well=20_000.0), times, True)


def test_every_command_ends_well(brackets: Taken, jpegs: Taken) -> None:
    for taken in (brackets, jpegs):
        assert taken.exits == dict.fromkeys(taken.exits, 0)


def test_light_of_given_poses_has_the_colours_of_the_files(brackets: Taken) -> None:
    figures = judge.light_figures(brackets.reconstruction, brackets.light, parts(brackets))
    assert figures["psnr"] > 20
    assert figures["stops"] < 0.6
    assert figures["stops_matte"] < 0.45
    assert figures["stops_background"] < 0.9  # 1.2 of Gaussians alone


def test_evaluate_agrees(brackets: Taken) -> None:
    metrics = store.read_json(brackets.reconstruction / "metrics.json")
    figures = judge.light_figures(brackets.reconstruction, brackets.light)
    assert metrics["hdr_psnr_mu_aligned"] == pytest.approx(figures["psnr"], abs=0.1)


def test_the_ratios_of_twelve_bit_brackets_are_measured(brackets: Taken) -> None:
    figures = judge.exposure_figures(brackets.session, brackets.shots)
    assert figures["ratios_labelled"] > 0.02
    assert figures["ratios"] < 0.01


def test_a_curve_that_is_not_srgb_is_measured(jpegs: Taken) -> None:
    assert judge.response_figure(jpegs.session) < 0.01
    figures = judge.exposure_figures(jpegs.session, jpegs.shots)
    # A curve and exposures that follow it look the same but for its ends: labels are halved, no more.
    assert figures["ratios"] < 0.7 * figures["ratios_labelled"]


def parts(taken: Taken) -> dict[str, np.ndarray]:
    return {"matte": taken.scene.where("floor", "crate"), "background": taken.scene.where("background")}
