"""What `rig cameras` lists, on a bus with everything on it."""

import pytest

from drivers.camera import Camera
from drivers.discovery import ask_all, find_cameras
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import Holder


@pytest.fixture
def mixed() -> BusRig:
    """Two still cameras and a machine vision camera."""
    rig = simulate("toy", seed=2)
    bus = BusRig(rig)
    other = simulate("toy", seed=9, cameras=3)
    bus.backend.plug(U3vDevice(other.devices[2], bus.clock))
    return bus


def test_every_camera_is_asked_and_let_go(mixed: BusRig) -> None:
    listed = list(ask_all(mixed.backend, mixed.clock))
    assert [one.protocol for one in listed] == ["PTP", "PTP", "USB3 Vision"]
    for one in listed:
        assert one.error == ""
        assert one.identity is not None
        assert one.capabilities is not None
        assert one.capabilities.times[0] < 1 / 1000 < 1 < one.capabilities.times[-1]
        assert one.verified
    assert mixed.backend.open_handles == 0


def test_a_camera_that_another_program_holds_is_told_and_the_others_are_listed(mixed: BusRig) -> None:
    serial = find_cameras(mixed.backend, mixed.clock)[0].identify().serial
    mixed.backend.hold(serial, Holder.OTHER_PROGRAM)
    held, *others = ask_all(mixed.backend, mixed.clock)
    assert "held by another program" in held.error
    assert held.identity is None
    assert all(one.error == "" for one in others)


def test_drivers_follow_one_protocol(mixed: BusRig) -> None:
    cameras: list[Camera] = find_cameras(mixed.backend, mixed.clock)
    serials = [camera.identify().serial for camera in cameras]
    assert len(set(serials)) == 3
    for camera in cameras:
        camera.close()
    assert mixed.backend.open_handles == 0
