"""The foreign room in one photograph a view, each at an exposure of its own: light by no bracket."""

import pytest

from imaging.files import store
from rig.__main__ import main

from . import judge, subjects
from .folder import Body, photograph, tell_poses
from .taken import Taken, all_measured

pytest.importorskip("mitsuba")

SINGLE = ((1 / 8,), (1 / 2,), (1 / 15,), (1 / 4,), (1.0,))


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Taken:
    """The room as `test_room` has it rendered, as RAW files with poses; labels are 4 % off."""
    folder = tmp_path_factory.mktemp("single")
    scene = subjects.room(views=18, width=160, samples=4, traced=64)
    light = scene.light()
    shots = photograph(folder / "photos", light, Body(14, seed=2), SINGLE)
    tell_poses(shots, scene.poses, scene.focal, (scene.width, scene.height), scene.surface_points())
    session = folder / "S"
    exits = {"import": main(["import", str(shots.folder), str(session)])}
    exits["check"] = main(["check", str(session)])
    exits["calibrate"] = main(["calibrate", str(session), "--only", "response"])
    judge.tell_truth(session, light, scene.poses, shots)
    settings = ("iterations=80", "gaussians=5000", "refine=none", "environment=0")
    few = ["--quality", "draft", *(word for setting in settings for word in ("--set", setting))]
    with all_measured():
        exits["reconstruct"] = main(["reconstruct", str(session), *few, "--name", "scene"])
    return Taken(scene, light, shots, session, exits)


def test_every_command_ends_well(single: Taken) -> None:
    assert single.exits == dict.fromkeys(single.exits, 0)


def test_every_photograph_is_a_view_of_its_own(single: Taken) -> None:
    folders = sorted((single.session / "raw").iterdir())
    assert [path.name for path in folders] == [f"{view:04d}" for view in range(18)]
    assert all(len(list(path.iterdir())) == 1 for path in folders)


def test_held_out_views_show_the_light_of_all_exposures(single: Taken) -> None:
    """Photographs span four stops, and light eighteen: what one clips or drowns others show.

    Ten trainings (five seeds, rays that differ by rounding) have 0.53 to 0.78 stops at the bright end.
    """
    figures = judge.light_figures(single.reconstruction, single.light)
    assert figures["psnr"] > 33
    assert figures["stops"] < 0.4
    assert figures["stops_dark"] < 0.9
    assert figures["stops_bright"] < 0.9


def test_evaluate_agrees(single: Taken) -> None:
    metrics = store.read_json(single.reconstruction / "metrics.json")
    figures = judge.light_figures(single.reconstruction, single.light)
    assert metrics["hdr_psnr_mu_aligned"] == pytest.approx(figures["psnr"], abs=0.1)
    assert metrics["stops_median"] == pytest.approx(figures["stops"], rel=0.02)
