"""Files that cameras made are decoded on the disk: no camera waits for that, and damage is found."""

from pathlib import Path
from typing import Any

import pytest

from capture.record import recorder
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.ptp import PtpCamera
from drivers.sim.bus_rig import BusRig
from drivers.sim.ptp import shooting
from drivers.sim.ptp.profiles import CameraProfile
from drivers.sim.ptp.store import Photograph
from imaging.files.raw import read_raw
from imaging.files.tiff.dng import encode_dng
from tests.capture.record.test_kept_shots import Capture

DECODING = 1.5
"""Seconds of the virtual clock."""
STEPS = 4


@pytest.mark.parametrize("model", ["generic", "sony-a7m4"])
def test_the_next_shot_does_not_wait_until_a_file_is_decoded(
    model: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also of bodies that are emptied before they expose again."""
    clocks: list[Clock] = []
    opened: list[float] = []
    cameras, trigger, must_decode = BusRig.cameras, PtpCamera.trigger, recorder.must_decode

    def noting_the_clock(rig: BusRig) -> list[Camera]:
        clocks.append(rig.clock)
        return cameras(rig)

    def noting_the_time(camera: PtpCamera) -> float:
        opened.append(trigger(camera))
        return opened[-1]

    def taking_long(session: Any, saved: Any) -> None:
        clocks[-1].sleep(DECODING)
        must_decode(session, saved)

    monkeypatch.setattr(BusRig, "cameras", noting_the_clock)
    monkeypatch.setattr(PtpCamera, "trigger", noting_the_time)
    times = (1 / 8,) * STEPS
    fast = Capture(tmp_path / "fast", bandwidth=None, times=times, model=model)
    soon, opened[:] = sorted(opened), []
    monkeypatch.setattr(recorder, "must_decode", taking_long)
    slow = Capture(tmp_path / "slow", bandwidth=None, times=times, model=model)
    late = sorted(opened)
    assert (fast.result.missing, slow.result.missing) == ((), ())
    assert len(late) == len(soon) == 2 * 2 * STEPS
    assert late[: 2 * STEPS] == pytest.approx(soon[: 2 * STEPS])  # of the first frame
    assert slow.seconds >= 2 * 2 * STEPS * DECODING
    assert slow.files() == fast.files()


def test_a_file_whose_pixels_are_damaged_is_taken_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def damaged_once(frame: Any, profile: CameraProfile) -> Photograph:
        data = bytearray(encode_dng(frame, "ljpeg"))
        made.append(frame.metadata)
        if len(made) == 3:
            middle = len(data) // 2
            data[middle : middle + 20] = b"\xff\xd9" * 10
        height, width = frame.pixels.shape
        taken = frame.metadata.captured_at
        return Photograph(bytes(data), profile.raw_format, ".DNG", width, height, taken)

    monkeypatch.setattr(shooting, "photograph", damaged_once)
    captured = Capture(tmp_path / "damaged", bandwidth=None)
    assert (captured.result.missing, captured.result.problems) == ((), ())
    again = [shot for shot in captured.session.shots() if shot.retries]
    assert [(shot.frame, shot.retries) for shot in again] == [(0, 1)]
    for shot in captured.session.shots():
        exposure = read_raw(captured.session.file(shot)).metadata.exposure
        assert exposure is not None
        assert exposure.time == pytest.approx(shot.requested.time, rel=0.03)


def test_a_file_that_stays_damaged_is_missing_and_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def damaged(frame: Any, profile: CameraProfile) -> Photograph:
        data = bytearray(encode_dng(frame, "ljpeg"))
        if frame.metadata.exposure.time > 1.0:
            data[len(data) // 2 :] = b"\xff\xd9" * (len(data) - len(data) // 2 + 1 >> 1)
        height, width = frame.pixels.shape
        return Photograph(bytes(data), profile.raw_format, ".DNG", width, height, frame.metadata.captured_at)

    monkeypatch.setattr(shooting, "photograph", damaged)
    captured = Capture(tmp_path / "damaged", bandwidth=None, times=(1 / 8, 2.0))
    assert len(captured.result.missing) == 4
    assert "delivered a damaged file" in captured.result.missing[0]
    assert len(captured.files()) == len(captured.session.shots()) == 4
