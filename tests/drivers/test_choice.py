"""Choice of the driver for a still camera: libgphoto2's virtual Nikon is at the place of the one on the
bus.
"""

import ctypes
from dataclasses import replace

import pytest

from drivers.camera import Capabilities
from drivers.clock import SystemClock
from drivers.discovery import ConnectedCamera, ask_all, find_cameras
from drivers.gphoto2.camera import Gphoto2Camera
from drivers.ptp.protocol.codes import VendorId
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp import dials
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from tests.drivers.gphoto2.conftest import virtual as virtual
from tests.drivers.ptp.test_vusb import VirtualNikon, _places
from tests.drivers.test_plugins import NoNetwork
from tests.drivers.test_plugins import nothing_else as nothing_else

pytestmark = pytest.mark.usefixtures("nothing_else", "virtual")


def listed(bus: VirtualBus) -> ConnectedCamera:
    (one,) = ask_all(bus, SystemClock(), network=NoNetwork())
    return one


def without_time(bus: VirtualBus) -> None:
    """Plug in a body whose exposure time stands on its dial: what can be set is the rest."""
    rig = simulate("toy")
    limited = replace(profile("generic"), dials=(dials.F_NUMBER, dials.EXPOSURE_INDEX))
    camera = SimulatedCamera(rig.bodies[0], lambda frame: rig.radiance(0, frame))
    bus.plug(PtpDevice(Responder(camera, limited, VirtualClock())))


def test_rigs_own_driver_is_first_where_it_can_set_the_camera() -> None:
    """Both drive the same one: libgphoto2's, whose port is on our bus too."""
    places = _places()
    assert places is not None
    bus, nikon = VirtualBus(VirtualClock()), VirtualNikon(ctypes.CDLL(str(places[0])))
    bus.plug(nikon)
    one = listed(bus)
    assert (one.protocol, one.error) == ("PTP", "")
    assert one.chosen == "rig's own PTP, which can set and trigger it"
    nikon.close()


def test_libgphoto2_drives_what_only_it_can_set() -> None:
    bus = VirtualBus(VirtualClock())
    without_time(bus)
    one = listed(bus)
    assert one.where == "gphoto2:usb:001,001"
    assert one.capabilities is not None
    assert len(one.capabilities.times) == 9
    assert one.chosen == "libgphoto2, as rig's own PTP finds that its exposure time cannot be set"
    assert bus.open_handles == 0


def of_make(bus: VirtualBus, maker: str, extension: int) -> None:
    """Plug in a body that lists all that the standard has, as makers do whose bodies want more."""
    rig = simulate("toy")
    changed = replace(profile("generic"), maker=maker, extension=extension)
    camera = SimulatedCamera(rig.bodies[0], lambda frame: rig.radiance(0, frame))
    bus.plug(PtpDevice(Responder(camera, changed, VirtualClock())))


@pytest.mark.parametrize(
    ("maker", "extension", "why"),
    [
        ("FUJIFILM", VendorId.FUJI, "as rig's own PTP finds that its make needs a handshake"),
        ("FUJIFILM", VendorId.MICROSOFT, "as rig's own PTP finds that its make needs a handshake"),
        (
            "OLYMPUS",
            VendorId.MICROSOFT,
            "since rig's own PTP driver does not know the handshake of this make",
        ),
        ("Nikon", VendorId.NIKON, "since rig's own PTP driver does not know the handshake of this make"),
    ],
)
def test_libgphoto2_drives_a_make_that_may_want_a_handshake(maker: str, extension: int, why: str) -> None:
    """Such a body lists InitiateCapture, and a time that can be set; of Nikon, one without Nikon's own."""
    bus = VirtualBus(VirtualClock())
    of_make(bus, maker, extension)
    one = listed(bus)
    assert one.where == "gphoto2:usb:001,001"
    assert one.chosen.startswith(f"libgphoto2, {why}")
    assert bus.open_handles == 0


def test_without_libgphoto2_a_make_that_wants_a_handshake_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.gphoto2.library.find_spec", lambda name: None)
    bus = VirtualBus(VirtualClock())
    of_make(bus, "FUJIFILM", VendorId.FUJI)
    assert "needs a handshake that only libgphoto2 supports: pip install" in listed(bus).trouble


def test_what_libgphoto2_cannot_drive_either_stays_with_the_standard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        "drivers.gphoto2.camera.Gphoto2Camera.capabilities",
        lambda camera: Capabilities(0, 0, 0, (), (), (), "libgphoto2 cannot trigger it"),
    )
    bus = VirtualBus(VirtualClock())
    of_make(bus, "Kodak", VendorId.MICROSOFT)
    one = listed(bus)
    assert one.chosen == "rig's own PTP in its standard form, as libgphoto2 cannot set and trigger it"
    assert one.trouble == ""


def test_what_is_no_ptp_camera_is_libgphoto2s() -> None:
    one = listed(VirtualBus(VirtualClock()))
    assert (one.protocol, one.chosen) == ("libgphoto2", "libgphoto2, as it is no PTP camera")


def test_a_simulated_bus_and_a_machine_without_the_package_have_no_choice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bus = VirtualBus(VirtualClock())
    without_time(bus)
    (one,) = ask_all(bus, SystemClock())
    assert (one.protocol, one.chosen) == ("PTP", "")
    assert "its exposure time cannot be set" in one.trouble
    monkeypatch.setattr("drivers.gphoto2.library.find_spec", lambda name: None)
    assert listed(bus) == one
    assert not any(
        isinstance(camera, Gphoto2Camera) for camera in find_cameras(bus, SystemClock(), NoNetwork())
    )
