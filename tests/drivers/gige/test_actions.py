"""Cameras that one command over the network triggers together, at once and at a time."""

import time
from collections.abc import Sequence

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import CameraRefused, CameraTimeout
from drivers.genicam.timestamps import Latch
from drivers.gige import GigeCamera
from drivers.gige.actions import AHEAD, DEVICE_KEY, GROUP_KEY, GROUP_MASK, NetworkTime, fire
from drivers.gige.session import ActionTeam
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import together

from .fakes import ARAVIS, aravis_fake, camera_at, only_at, port_of_aravis, viva_fake
from .rows import MakeRow
from .test_sim_device import LABEL, shoot

SKEWS = (0.0, 40e-6, 3e-3, 1.5e-3)
WANTED = 10e-6
"""Seconds within which what was injected is to be given back."""


def join(cameras: Sequence[GigeCamera]) -> ActionTeam:
    team = ActionTeam()
    for camera in cameras:
        camera.join(team, leads=camera is cameras[0])
    return team


def openings(frames: Sequence[RawMosaic]) -> list[float]:
    """Opening of each, after the first camera."""
    moments = [frame.metadata.opened for frame in frames]
    known = [moment for moment in moments if moment is not None]
    assert len(known) == len(frames)
    return [moment - known[0] for moment in known]


@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_injected_skew_is_given_back_within_10_us(
    make_row: MakeRow, monkeypatch: pytest.MonkeyPatch, loss: float
) -> None:
    """The cameras share a time, each to within 200 ns; of all packets one in twenty is lost, commands too."""
    monkeypatch.setattr("drivers.gige.camera.AHEAD", 0.9)  # devices and hosts share the cores of a test run
    row = make_row(4, skews=SKEWS)
    team = join(row.cameras)
    assert all(camera.wait_for_time(5.0) for camera in row.cameras)
    assert team.synchronised
    row.lose(loss)
    for _ in range(3):
        frames = together(row.cameras, LABEL)
        moments = openings(frames)
        assert moments == pytest.approx(SKEWS, abs=WANTED)
        truth = [device.opened[-1] - row.devices[0].opened[-1] for device in row.devices]
        assert moments == pytest.approx(truth, abs=WANTED)
        assert frames[0].metadata.opened == pytest.approx(row.devices[0].opened[-1], abs=0.05)
        for frame, twin in zip(frames, row.twins, strict=True):
            assert np.array_equal(frame.pixels, shoot(twin).pixels)
    row.lose(0.0)
    assert [len(device.opened) for device in row.devices] == [3, 3, 3, 3]


def test_cameras_without_a_common_time_are_triggered_at_once(make_row: MakeRow) -> None:
    """Their clocks are hours apart and drift; each moment is known as well as that camera answers."""
    row = make_row(3, skews=(0.0, 0.05, 0.0), synchronised=False)
    team = join(row.cameras)
    assert not any(camera.wait_for_time(0.0) for camera in row.cameras)
    assert not team.synchronised
    frames = together(row.cameras, LABEL)
    for frame, device, twin in zip(frames, row.devices, row.twins, strict=True):
        assert frame.metadata.opened == pytest.approx(device.opened[-1], abs=0.02)
        assert np.array_equal(frame.pixels, shoot(twin).pixels)
    first, second, third = (device.opened[-1] for device in row.devices)
    assert second - third > 0.03
    assert abs(first - third) < AHEAD


def test_one_camera_without_the_time_has_all_triggered_at_once(make_row: MakeRow) -> None:
    row = make_row(2)
    team = join(row.cameras)
    assert all(camera.wait_for_time(5.0) for camera in row.cameras)
    row.devices[1]._agree_on_time(False)
    together(row.cameras, LABEL)
    assert not team.synchronised
    assert row.devices[0].opened[-1] == pytest.approx(row.devices[1].opened[-1], abs=AHEAD / 2)


def test_a_camera_that_no_command_reaches_has_no_frame_and_the_others_have(
    make_row: MakeRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.genicam.camera._LINE_GRACE", 0.3)
    row = make_row(2)
    join(row.cameras)
    second = row.cameras[1]
    second.set_exposure(LABEL)
    assert second._session is not None
    second._session.nodes.set("ActionGroupKey", 77)
    for camera in row.cameras:
        camera.arm()
        camera.trigger()
    assert row.cameras[0].collect().pixels.shape == (48, 64)
    with pytest.raises(CameraTimeout, match=r"got no pulse on Action0 .* its commands reach this one"):
        second.collect()


def test_cameras_without_actions_are_refused() -> None:
    with aravis_fake() as address:
        camera = camera_at(address)
        with pytest.raises(CameraRefused, match=f"GigE {ARAVIS} has no action commands"):
            camera.join(ActionTeam(), leads=True)
        assert shoot(camera, Exposure(time=0.01)).pixels.shape == (512, 512)
        camera.close()


def test_viva_camera_takes_our_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    with viva_fake() as fake:
        fire([fake.ip], "127.0.0.1", None)
        assert fake.actions() == 0  # of other keys
        for name in ("DEVICE_KEY", "GROUP_KEY", "GROUP_MASK"):
            monkeypatch.setattr(f"drivers.gige.actions.{name}", getattr(fake, name))
        fire([fake.ip], "127.0.0.1", None)
        deadline = time.monotonic() + 5
        while not fake.actions() and time.monotonic() < deadline:
            only_at(fake.ip).discover()  # it answers when it has done what was asked before
        assert 1 <= fake.actions() <= 5  # told again where its answer took long


def test_viva_commands_our_cameras(make_row: MakeRow) -> None:
    viva = pytest.importorskip("viva_genicam", reason="the package viva-genicam is not installed")
    with port_of_aravis():
        row = make_row(addresses=(ARAVIS,))
        (camera,), (device,) = row.cameras, row.devices
        join(row.cameras)
        assert camera.wait_for_time(5.0)
        for scheduled in (False, True):
            camera.set_exposure(LABEL)
            camera.arm()
            now = SystemClock().now()
            when = device.nanoseconds(now + 0.2) if scheduled else None
            viva.send_action(
                DEVICE_KEY, GROUP_KEY, GROUP_MASK, scheduled_time=when, destination=ARAVIS, timeout_ms=100
            )
            assert camera._session is not None
            frame = camera._session.stream.next_frame(5.0)
            assert frame.problem is None
            opened = device.opened[-1] - now
            assert opened == pytest.approx(0.2, abs=1e-6) if scheduled else 0.0 < opened < 0.1


def test_a_time_that_differs_is_not_shared() -> None:
    time = NetworkTime()
    assert time.agrees(Latch(100.0, 5_000_000_000, 1e-4))
    assert time.agrees(Latch(101.0, 6_000_100_000, 1e-4))
    assert not time.agrees(Latch(101.0, 6_010_000_000, 1e-4))
    assert not time.agrees(Latch(101.0, 0, 1e-4))
    assert time.on_host(5_500_000_000) == pytest.approx(100.5)
    # After a while host and network are compared anew, for what comes then.
    assert time.agrees(Latch(120.0, 25_001_000_000, 1e-4))
    assert time.on_host(25_000_000_000) == pytest.approx(120.0)
    assert time.on_host(25_002_000_000) == pytest.approx(120.001)
