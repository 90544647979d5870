"""Listing of `rig cameras`, on a bus with everything on it."""

import threading

import pytest
import usb.core

from drivers import discovery
from drivers.at_once import all_at_once
from drivers.camera import Camera, CameraIdentity, Capabilities
from drivers.clock import SystemClock
from drivers.discovery import ask_all, find_cameras
from drivers.errors import CameraNotFound
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import Holder, VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock


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


def test_a_device_that_cannot_be_read_hides_no_other(mixed: BusRig, monkeypatch: pytest.MonkeyPatch) -> None:
    real = mixed.backend.get_configuration_descriptor
    first = next(iter(mixed.backend.enumerate_devices()))

    def read(device: object, configuration: int) -> object:
        if device is first:
            raise usb.core.USBError("Entity not found", -5, 2)
        return real(device, configuration)

    monkeypatch.setattr(mixed.backend, "get_configuration_descriptor", read)
    assert [one.error for one in ask_all(mixed.backend, mixed.clock)] == ["", ""]


def test_drivers_follow_one_protocol(mixed: BusRig) -> None:
    cameras: list[Camera] = find_cameras(mixed.backend, mixed.clock)
    serials = [camera.identify().serial for camera in cameras]
    assert len(set(serials)) == 3
    for camera in cameras:
        camera.close()
    assert mixed.backend.open_handles == 0


class _Remote:
    """A camera of a network that says nothing until all the others were asked, too."""

    def __init__(self, number: int, others: threading.Barrier) -> None:
        self.where, self._number, self._others, self.closed = f"PTP/IP {number}", number, others, False

    def identify(self) -> CameraIdentity:
        self._others.wait(timeout=5.0)
        if self._number == 3:
            raise CameraNotFound("PTP/IP 3 cannot be reached: correct the address.")
        return CameraIdentity(str(self._number), "Acme", "Z1", "raw")

    def verified(self) -> str:
        return ""

    def capabilities(self) -> Capabilities:
        return Capabilities(0, 0, 0, (), (), ())

    def close(self) -> None:
        self.closed = True


def test_cameras_of_a_network_are_asked_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    others = threading.Barrier(9)
    cameras = [_Remote(number, others) for number in range(9)]
    monkeypatch.setattr(
        discovery, "_by_protocol", lambda *_: iter([("PTP/IP", camera, "") for camera in cameras])
    )
    listed = list(ask_all(VirtualBus(VirtualClock()), SystemClock()))
    assert [one.where for one in listed] == [camera.where for camera in cameras]
    assert [one.error for one in listed if one.error] == ["PTP/IP 3 cannot be reached: correct the address."]
    assert [one.identity.serial for one in listed if one.identity] == list("01245678")
    assert all(camera.closed for camera in cameras)


def test_the_first_error_of_calls_side_by_side_is_raised() -> None:
    assert all_at_once([lambda: 1, lambda: 2]) == [1, 2]
    with pytest.raises(ZeroDivisionError):
        all_at_once([lambda: 1, lambda: 1 // 0])
