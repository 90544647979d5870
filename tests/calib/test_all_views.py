"""Features of all views are the same for any number of processes."""

from pathlib import Path

import numpy as np
import pytest

from calib import all_views
from calib.data import features
from calib.data.views import View, scene_views
from calib.view_images import summarise
from imaging.compute import memory
from imaging.session.calibration import read_calibration
from imaging.session.session import Session


def enlarged(view: View, factor: int) -> View:
    """A view that claims to have so many times the pixels along each side."""
    shots = [
        shot.model_copy(update={"width": factor * shot.width, "height": factor * shot.height})
        for shot in view.shots
    ]
    return View(view.camera, view.frame, tuple(shots))


def test_another_process_sees_what_this_one_does(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Others do not know that tests look for fewer features."""
    monkeypatch.setattr(features, "PIXELS_EACH", features.PIXELS_EACH // 2)
    session, record = Session.open(arm), read_calibration(arm)
    view = scene_views(session)[0]
    asked = (session, view, record.exposure_scale, record.camera(view.camera.name).response, None)
    here, there = (next(all_views.in_processes(count, summarise, [asked])).arrays() for count in (1, 2))
    assert here.keys() == there.keys()
    assert all(
        np.array_equal(here[name], there[name], equal_nan=name in ("brightness", "colour")) for name in here
    )
    assert len(here["points"]) > 100


@pytest.mark.parametrize(
    ("cores", "free", "factor", "count"),
    [
        (8, 1e12, 1, 1),
        (8, 1e12, 10, 8),
        (1, 1e12, 10, 1),
        (100, 1e12, 10, 12),
        (8, 6e9, 10, 2),
        (8, 1e6, 10, 1),
    ],
    ids=[
        "small images",
        "a core each",
        "one core",
        "as many as views",
        "as memory has room for",
        "no memory",
    ],
)
def test_as_many_processes_as_there_are_cores_and_memory_for(
    arm: Path, monkeypatch: pytest.MonkeyPatch, cores: int, free: float, factor: int, count: int
) -> None:
    views = [enlarged(view, factor) for view in scene_views(Session.open(arm))[:12]]
    monkeypatch.setattr(all_views, "available_cores", lambda: cores)
    monkeypatch.setattr(memory, "available", lambda: int(free))
    assert all_views.processes(views) == count
    # Each may ask for what reading the largest picture is said to take, beside itself.
    picture = memory.PER_SAMPLE * views[0].shots[0].width * views[0].shots[0].height
    assert count == 1 or free / count > all_views.PER_PROCESS + picture
