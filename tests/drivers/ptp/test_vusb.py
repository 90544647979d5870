"""Our driver against a camera that somebody else wrote: libgphoto2's virtual Nikon, from the gphoto2 wheel.

It splits header and payload, appends the response to the last data, and wants OpenSession first. Its port
is reached with ctypes and plugged into the virtual bus, so that everything from pyusb on is ours.
"""

import ctypes
import importlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.ptp.protocol.codes import FormatCode, PropertyCode
from drivers.ptp.protocol.session import Download, PtpSession
from drivers.ptp.protocol.transport import UsbTransport
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.descriptors import Description, Endpoint, Interface
from drivers.sim.usb.port import Port, Setup, Stall
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.usb import STILL_IMAGE, find

OUT, IN, EVENTS, PACKET = 0x02, 0x81, 0x83, 512
PICTURE = bytes(range(256)) * 3000


def _places() -> tuple[Path, Path] | None:
    """libgphoto2_port and the folder of vusb.so, if the wheel is installed."""
    spec = importlib.util.find_spec("gphoto2")
    if spec is None or not spec.submodule_search_locations:
        return None
    package = Path(spec.submodule_search_locations[0])
    libraries = sorted((package.parent / "gphoto2.libs").glob("libgphoto2_port-*"))
    folder = package / "libgphoto2" / "vusb"
    return (libraries[0], folder) if libraries and (folder / "vusb.so").is_file() else None


class VirtualNikon:
    """libgphoto2's virtual camera as a device on our bus."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library, self._gphoto_port = library, ctypes.c_void_p()
        ports, info = ctypes.c_void_p(), ctypes.c_void_p()
        for call in (
            lambda: library.gp_port_info_list_new(ctypes.byref(ports)),
            lambda: library.gp_port_info_list_load(ports),
            lambda: library.gp_port_info_list_get_info(ports, 0, ctypes.byref(info)),
            lambda: library.gp_port_new(ctypes.byref(self._gphoto_port)),
            lambda: library.gp_port_set_info(self._gphoto_port, info),
            lambda: library.gp_port_open(self._gphoto_port),
        ):
            assert call() == 0
        self._received, self._port = b"", None

    @property
    def description(self) -> Description:
        code = (STILL_IMAGE.number, STILL_IMAGE.subclass, STILL_IMAGE.protocol)
        pipes = (
            Endpoint(OUT, "bulk", PACKET),
            Endpoint(IN, "bulk", PACKET),
            Endpoint(EVENTS, "interrupt", 32),
        )
        return Description(0x04B0, 0x0437, ("Nikon", "D750", "1"), (Interface(0, code, pipes),))

    def on_attach(self, port: Port) -> None:
        self._port = port

    def on_bulk_out(self, endpoint: int, packet: bytes) -> None:
        self._received += packet
        if len(packet) < PACKET:
            sent, self._received = self._received, b""
            assert self._library.gp_port_write(self._gphoto_port, sent, len(sent)) == len(sent)
            self._forward()

    def _forward(self) -> None:
        """Every read of its own becomes a transfer of its own."""
        assert self._port is not None
        buffer = ctypes.create_string_buffer(1 << 20)
        while (count := self._library.gp_port_read(self._gphoto_port, buffer, len(buffer))) > 0:
            self._port.send(IN, buffer.raw[:count])

    def on_control(self, setup: Setup, data: bytes) -> bytes:
        raise Stall

    def on_clear_halt(self, endpoint: int) -> None:
        pass

    def on_reset(self) -> None:
        self._received = b""

    def close(self) -> None:
        self._library.gp_port_close(self._gphoto_port)
        self._library.gp_port_free(self._gphoto_port)


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[PtpSession]:
    places = _places()
    if places is None:
        pytest.skip("the gphoto2 wheel with its virtual camera is not installed")
    library, folder = places
    (tmp_path / "DCIM" / "100RIGXX").mkdir(parents=True)
    (tmp_path / "DCIM" / "100RIGXX" / "IMG_0001.JPG").write_bytes(PICTURE)
    # It brings the libraries that the port library needs, and sets IOLIBS for good.
    importlib.import_module("gphoto2")
    monkeypatch.setenv("IOLIBS", str(folder))
    monkeypatch.setenv("VCAMERADIR", str(tmp_path))
    nikon, clock = VirtualNikon(ctypes.CDLL(str(library))), VirtualClock()
    bus = VirtualBus(clock)
    bus.plug(nikon)
    pipe = find(STILL_IMAGE, bus)[0].open()
    yield PtpSession(UsbTransport(pipe, clock), clock)
    nikon.close()


def test_open_info_properties_and_download(session: PtpSession) -> None:
    info = session.open()
    assert info.model
    assert PropertyCode.BATTERY_LEVEL in info.properties
    battery = session.describe(PropertyCode.BATTERY_LEVEL)
    assert 0 <= int(battery.current) <= 100
    handles = {session.object_info(handle).filename: handle for handle in session.handles()}
    assert "IMG_0001.JPG" in handles
    handle = handles["IMG_0001.JPG"]
    about = session.object_info(handle)
    assert (about.size, about.format) == (len(PICTURE), FormatCode.EXIF_JPEG)
    one = Download(handle, about, bytearray())
    assert session.download(one) == PICTURE
    session.close()
