"""A foreign room with lamps, gold, mirror and glass, in RAW brackets: the whole way, as a user goes it."""

import numpy as np
import pytest

from imaging.files import store
from rig.__main__ import main

from . import judge, subjects
from .folder import Body, photograph
from .taken import Taken

pytest.importorskip("mitsuba")
pytestmark = pytest.mark.timeout(600)

BRACKET = (1 / 4000, 1 / 250, 1 / 15, 1.0)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Taken:
    folder = tmp_path_factory.mktemp("room")
    scene = subjects.room(views=18, width=160, samples=4, traced=64)
    light = scene.light()
    shots = photograph(folder / "photos", light, Body(14, seed=1), (BRACKET,))
    session = folder / "S"
    exits = {"import": main(["import", str(shots.folder), str(session)])}
    taken = Taken(scene, light, shots, session, exits)
    exits["check"] = main(["check", str(session)])
    exits["calibrate"] = main(["calibrate", str(session)])
    exits["merge"] = main(["merge", str(session), str(taken.merged)])
    judge.tell_truth(session, light, scene.poses, shots)
    trained = ["--quality", "draft", "--set", "iterations=200", "--name", "scene"]
    exits["reconstruct"] = main(["reconstruct", str(session), *trained])
    exits["evaluate"] = main(["evaluate", str(taken.reconstruction)])
    return taken


def test_the_room_has_eighteen_stops(room: Taken) -> None:
    assert room.light.max() / np.percentile(room.light, 0.1) > 2**17.5


def test_every_command_ends_well(room: Taken) -> None:
    assert room.exits == dict.fromkeys(room.exits, 0)


def test_photographs_are_brackets_of_four(room: Taken) -> None:
    views = sorted(path.name for path in (room.session / "raw").iterdir())
    assert views == [f"{view:04d}" for view in range(18)]
    assert all(len(list(path.iterdir())) == 4 for path in (room.session / "raw").iterdir())


def test_views_stand_where_they_were_taken(room: Taken) -> None:
    figures = judge.pose_figures(room.session, room.scene.poses, room.scene.focal)
    assert figures["placed"] == 18
    assert figures["wrong"] == 0
    assert figures["degrees"] < 0.2
    assert figures["auc"] > 0.6
    assert abs(figures["focal"]) < 0.005


def test_exposures_are_measured_and_not_believed(room: Taken) -> None:
    figures = judge.exposure_figures(room.session, room.shots)
    assert figures["ratios_labelled"] > 0.02
    assert figures["ratios"] < 0.004


def test_merged_brackets_are_the_light(room: Taken) -> None:
    figures = judge.merge_figures(room.merged, room.light)
    assert figures["merge_psnr"] > 40
    assert figures["merge_stops"] < 0.13
    assert 0.4 < figures["chi"] < 2.5


def test_held_out_views_show_the_light(room: Taken) -> None:
    figures = judge.light_figures(room.reconstruction, room.light)
    assert figures["psnr"] > 34
    assert figures["stops"] < 0.3
    assert figures["stops_dark"] < 0.8


def test_evaluate_agrees(room: Taken) -> None:
    metrics = store.read_json(room.reconstruction / "metrics.json")
    figures = judge.light_figures(room.reconstruction, room.light)
    assert metrics["hdr_psnr_mu_aligned"] == pytest.approx(figures["psnr"], abs=0.1)
    assert metrics["stops_median"] == pytest.approx(figures["stops"], rel=0.02)
