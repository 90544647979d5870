"""Warnings of `rig check`: one fault at a time in a sound session, and only that."""

import cv2
import numpy as np
import pytest

from capture.check.check import check
from capture.check.findings import CheckReport
from capture.check.picture_warnings import doubted
from imaging.optics.exposure import Exposure

from .brackets import Studio, blurred, scene, shifted

BRACKET = [Exposure(time=time) for time in (1 / 2, 1 / 8, 1 / 32)]
FRAMES = 4


def shot(
    tmp_path, *, cameras=("a", "b", "c"), kind="raw", light=None, exposure=None, label=None
) -> CheckReport:
    """A session in which `light` and `exposure` (camera, frame, step, as it should be) may change a shot."""
    studio = Studio(tmp_path / "s", cameras, kind)
    studio.plan(BRACKET, FRAMES)
    for camera in cameras:
        for frame in range(FRAMES):
            for step, intended in enumerate(BRACKET):
                view = scene(10 * frame + studio.cameras.index(camera), 112, 160)
                place = (camera, frame, step)
                studio.shoot(
                    *place,
                    light(*place, view) if light else view,
                    exposure(*place, intended) if exposure else intended,
                    intended,
                )
    report = check(studio.folder)
    assert report.ok, report.problems
    assert report.sound == len(cameras) * FRAMES * len(BRACKET)
    return report


@pytest.mark.parametrize("kind", ["raw", "ldr"])
def test_a_session_that_is_right_has_no_warning(tmp_path, kind):
    report = shot(tmp_path, kind=kind)
    assert report.warnings == ()
    assert all(look.estimated is not None for look in report.looks)
    assert max(abs(look.off) for look in report.looks) < 0.05
    assert len(report.thumbnails) == len(report.looks)
    assert all(data.startswith(b"\xff\xd8") for data in report.thumbnails.values())


def test_a_shutter_that_is_always_off_is_told_once(tmp_path):
    def slow(camera, frame, step, intended):
        return intended.with_time(intended.time * (1.15 if (camera, step) == ("b", 1) else 1.0))

    (warning,) = shot(tmp_path, exposure=slow).warnings
    assert (warning.kind, warning.camera, warning.file) == ("label", "b", "")
    assert "in 4 of 4 frames" in warning.message
    assert "1/8 s" in warning.message


def test_a_shutter_that_sticks_once_is_told_with_its_file(tmp_path):
    def stuck(camera, frame, step, intended):
        return intended.with_time(intended.time * (1.3 if (camera, frame, step) == ("a", 2, 0) else 1.0))

    report = shot(tmp_path, exposure=stuck)
    (warning,) = report.warnings
    assert (warning.kind, warning.file) == ("label", "raw/scene/0002/a_0.dng")
    (look,) = [look for look in report.looks if doubted(look)]
    assert look.estimated.time == pytest.approx(1.3 / 2, rel=0.02)
    assert look.reported == BRACKET[0]


def test_a_frame_that_is_blurred_is_told(tmp_path):
    def shaken(camera, frame, step, view):
        return blurred(view, 2.0) if (camera, frame) == ("c", 1) else view

    (warning,) = shot(tmp_path, light=shaken).warnings
    assert (warning.kind, warning.camera, warning.frame) == ("focus", "c", 1)
    assert "shots from raw/scene/0001/c_0.dng on" in warning.message


def test_one_exposure_that_is_blurred_is_told(tmp_path):
    def shaken(camera, frame, step, view):
        return blurred(view, 2.0) if (camera, frame, step) == ("a", 0, 1) else view

    (warning,) = shot(tmp_path, light=shaken).warnings
    assert (warning.kind, warning.file) == ("focus", "raw/scene/0000/a_1.dng")


def test_a_camera_whose_focus_ring_moved_is_told(tmp_path):
    def soft(camera, frame, step, view):
        return blurred(view, 1.5) if camera == "b" else view

    (warning,) = shot(tmp_path, light=soft).warnings
    assert (warning.kind, warning.camera, warning.frame) == ("focus", "b", None)


def test_pictures_that_are_smaller_are_no_evidence_of_a_blurred_camera(tmp_path):
    """A lens that does not resolve the photosites does so at half the size."""

    def halved(camera, frame, step, view):
        lens = blurred(cv2.resize(view, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), 1.2)
        return lens if camera == "a" else cv2.resize(lens, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)

    report = shot(tmp_path, light=halved)
    sharp = {look.camera: look.sharpness for look in report.looks if look.step == 0}
    assert sharp["a"] < 0.6 * sharp["b"]
    assert not report.warnings


def test_a_camera_that_was_pushed_is_told(tmp_path):
    def pushed(camera, frame, step, view):
        return shifted(view, 1, 0) if (camera, frame) == ("a", 3) and step > 0 else view

    (warning,) = shot(tmp_path, light=pushed).warnings
    assert (warning.kind, warning.file) == ("motion", "raw/scene/0003/a_1.dng")
    assert "shifted by 1.0 pixels" in warning.message


def test_something_that_walked_by_is_told(tmp_path):
    def walker(camera, frame, step, view):
        if (camera, frame, step) == ("b", 0, 1):
            view = view.copy()
            view[20:38, 60:78] = 0.9
            view[20:38, 78:82] = 2.0
        return view

    warnings = shot(tmp_path, light=walker).warnings
    assert warnings
    assert {warning.kind for warning in warnings} == {"motion"}
    assert {(warning.camera, warning.frame) for warning in warnings} == {("b", 0)}


@pytest.mark.parametrize("frames", [range(1), range(FRAMES, 2 * FRAMES)], ids=["one", "others"])
def test_a_camera_that_saw_other_frames_is_compared_with_none(tmp_path, frames):
    studio = Studio(tmp_path / "s", ["a", "b"])
    studio.plan([BRACKET[0]], 2 * FRAMES)
    for frame in range(FRAMES):
        studio.shoot("a", frame, 0, scene(frame, 112, 160), BRACKET[0])
    for frame in frames:
        studio.shoot("b", frame, 0, blurred(scene(frame, 112, 160), 4.0), BRACKET[0])
    assert {warning.kind for warning in check(studio.folder).warnings} == {"clipped"}


def test_light_in_a_dark_frame_and_clipping_in_a_flat_are_told(tmp_path):
    studio = Studio(tmp_path / "s", ["a"])
    black, grey = np.zeros((64, 96, 3)), np.full((64, 96, 3), 1.0)
    leak = black.copy()
    leak[:8, :40] = 0.3
    for kind, lights in (("dark", (black, leak)), ("flat", (grey, 2.5 * grey))):
        studio.plan([BRACKET[0]], 2, kind)
        for frame, light in enumerate(lights):
            studio.shoot("a", frame, 0, light, BRACKET[0], kind=kind)
    report = check(studio.folder)
    assert report.ok
    assert [(warning.kind, warning.file) for warning in report.warnings] == [
        ("dark", "raw/dark/0001/a_0.dng"),
        ("flat", "raw/flat/0001/a_0.dng"),
    ]
    assert all(look.sharpness is None and look.estimated is None for look in report.looks)


def test_what_a_bracket_shows_in_one_exposure_only_tells_no_ratio(tmp_path):
    """Two views in one bracket, by mistake: a wrong ratio must not stand for an estimate."""

    def mixed(camera, frame, step, view):
        return scene(77, 112, 160) if step == 2 and frame == 0 else view

    report = shot(tmp_path, cameras=("a",), light=mixed)
    assert {warning.kind for warning in report.warnings} <= {"motion", "focus"}
    assert any(warning.kind == "motion" and warning.frame == 0 for warning in report.warnings)
    assert all(look.estimated is None for look in report.looks if look.frame == 0)


def test_a_file_that_was_altered_is_compared_with_nothing(tmp_path):
    studio = Studio(tmp_path / "s", ["a"])
    studio.plan(BRACKET, 1)
    for step, exposure in enumerate(BRACKET):
        file = studio.shoot("a", 0, step, scene(0, 112, 160), exposure)
    (studio.folder / file).write_bytes((studio.folder / file).read_bytes() + b"\0")
    report = check(studio.folder)
    assert [problem.kind for problem in report.problems] == ["altered"]
    assert [look.step for look in report.looks] == [0, 1]
    assert all(look.estimated is not None for look in report.looks)
