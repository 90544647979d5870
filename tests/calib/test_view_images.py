"""Images of views: any number of processes sees the same in them, by the exposures that show something."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import view_images
from calib.data import features
from calib.data.views import View, scene_views
from calib.view_images import _is_lit, summarise
from imaging.compute import memory
from imaging.compute.processes import in_processes
from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise
from imaging.session.calibration import read_calibration
from imaging.session.session import Session

NOISE = SensorSignalNoise(1e-4, 1e-6)


@pytest.fixture
def black() -> LinearFrame:
    """A frame of 400 x 300 that holds read noise alone."""
    signal = np.random.default_rng(0).normal(0, 1e-3, (300, 400)).astype(np.float32)
    none, every = np.zeros(signal.shape, bool), np.ones(signal.shape, bool)
    return LinearFrame(signal, 2.0**-26, saturated=none, dark=none, valid=every, noise=NOISE)


def test_a_black_frame_is_not_lit(black):
    assert not _is_lit(black)


@pytest.mark.parametrize("level", [0.01, 0.5])
def test_a_frame_of_a_few_lamps_is(black, level):
    signal = black.signal.copy()
    signal[100, 200:204] = level
    assert _is_lit(replace(black, signal=signal))


@pytest.mark.parametrize("step", [1, 2])
def test_a_lamp_of_one_colour_counts_as_one_of_all(black, step):
    """Light every second photosite of every second row by a blue lamp."""
    signal = black.signal.copy()
    signal[100:104:step, 200:204:step] = 0.01
    assert _is_lit(replace(black, signal=signal))


@pytest.mark.parametrize("level", [0.01, 1.0])
def test_hot_photosites_are_no_light(black, level):
    """One in ten thousand, as of a warm sensor; the brightest of them are saturated."""
    signal = black.signal.copy()
    signal[20::60, 30::50] = level
    hot = signal >= 1
    assert (signal >= level).mean() > 1e-4
    assert not _is_lit(replace(black, signal=signal, saturated=hot))


def test_so_are_a_saturated_one_and_one_of_unknown_noise(black):
    assert _is_lit(replace(black, saturated=np.ones_like(black.saturated)))
    assert _is_lit(replace(black, noise=None))


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
    here, there = (next(in_processes(count, summarise, [asked])).arrays() for count in (1, 2))
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
    monkeypatch.setattr(view_images, "available_cores", lambda: cores)
    monkeypatch.setattr(memory, "available", lambda: int(free))
    assert view_images.processes(views) == count
    # Each may ask for what reading the largest picture is said to take, beside itself.
    picture = memory.PER_SAMPLE * views[0].shots[0].width * views[0].shots[0].height
    assert count == 1 or free / count > view_images.PER_PROCESS + picture
