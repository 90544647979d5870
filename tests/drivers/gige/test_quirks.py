"""Quirks of real cameras: the driver gets the same frames, or reports the unknown."""

import re
import struct
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.chunks import ChunksRefused
from drivers.gige.control import ControlChannel
from drivers.gige.registers import URL_SIZE, Bootstrap
from drivers.sim.genicam.quirks import Quirk
from imaging.optics.exposure import Exposure
from tests.drivers.shots import together

from .fakes import own_address
from .rows import MakeRow, Row
from .test_actions import join
from .test_sim_device import LABEL, shoot

MEANT = Exposure(time=2.0**-8, iso=200)
"""Applied exposure for the label."""
UNTOLD = {Quirk.NO_UNITS, Quirk.GAMMA_LOCKED, Quirk.FEWER_ROWS}
"""Those of which something cannot be known or done."""


def quirky(make_row: MakeRow, *quirks: Quirk) -> Row:
    return make_row(quirks=frozenset(quirks))


@pytest.mark.parametrize("quirk", [one for one in Quirk if one not in UNTOLD], ids=lambda one: one.name)
def test_its_frames_are_those_of_any_other(make_row: MakeRow, quirk: Quirk) -> None:
    row = quirky(make_row, quirk)
    (camera,), (twin,) = row.cameras, row.twins
    for _ in range(2):
        frame, truth = shoot(camera), shoot(twin)
        assert np.array_equal(frame.pixels, truth.pixels)
        # It tells one level for both greens.
        assert np.mean(frame.black) == pytest.approx(np.mean(truth.black), abs=1e-3)
        assert (frame.cfa, frame.white) == (truth.cfa, truth.white)
        assert frame.metadata.exposure is not None
        assert frame.metadata.exposure.time == pytest.approx(MEANT.time, rel=1e-6)
        assert frame.metadata.exposure.iso == pytest.approx(200, rel=1e-3)
        assert frame.metadata.unknown == ()
        assert (frame.metadata.opened is None) == (quirk is Quirk.NO_STAMP)


def test_events_are_acknowledged_and_taken_for_no_answers(make_row: MakeRow) -> None:
    """Each comes before an answer and has its number: read as one, it would be a status of 0x4201."""
    row = quirky(make_row, Quirk.EVENTS)
    (camera,), (device,) = row.cameras, row.devices
    for _ in range(3):
        assert np.array_equal(shoot(camera).pixels, shoot(row.twins[0]).pixels)
    assert device.events.sent > 50
    assert device.events.unheard <= 1  # that of a heartbeat may be on its way
    camera.close()


def test_gain_and_black_without_a_unit_are_called_unknown(make_row: MakeRow) -> None:
    row = quirky(make_row, Quirk.NO_UNITS)
    (camera,) = row.cameras
    assert camera.capabilities().isos == ()
    frame = shoot(camera, Exposure(time=1 / 250))
    assert frame.metadata.exposure == Exposure(time=2.0**-8)
    assert frame.black == ((0.0,),)
    (unknown,) = frame.metadata.unknown
    assert re.search(r"black level without a unit: its files state 0; measure it from dark frames", unknown)
    with pytest.raises(CameraRefused, match="gain has no unit, and may be in dB or a factor: name no ISO"):
        camera.set_exposure(LABEL)


def test_a_frame_of_fewer_rows_is_told(make_row: MakeRow) -> None:
    (camera,) = quirky(make_row, Quirk.FEWER_ROWS).cameras
    with pytest.raises(
        CameraProtocol, match=r"ended it after 24 of 48 rows .variable height.: set a fixed height"
    ):
        shoot(camera)


@pytest.mark.parametrize("beside", [40, 60], ids=["asked first", "asked last"])
def test_a_camera_with_two_interfaces_is_one_and_controlled_where_it_can_be(
    make_row: MakeRow, beside: int
) -> None:
    """It answers at both, and takes control at one alone."""
    row = make_row(addresses=(own_address(50),), beside=own_address(beside))
    (camera,) = row.cameras
    assert np.array_equal(shoot(camera).pixels, shoot(row.twins[0]).pixels)
    camera.close()
    row.devices[0].close()


def test_packets_under_wrong_numbers_do_not_replace_those_that_came(make_row: MakeRow) -> None:
    """Renumber a fifth of all packets, also of those that are requested again, with losses beside."""
    row = quirky(make_row, Quirk.MISNUMBERED)
    row.devices[0].sender.loss = 0.1
    for _ in range(5):
        assert np.array_equal(shoot(row.cameras[0]).pixels, shoot(row.twins[0]).pixels)


def test_a_camera_whose_gamma_stays_on_is_refused(make_row: MakeRow) -> None:
    (camera,) = quirky(make_row, Quirk.GAMMA_LOCKED).cameras
    with pytest.raises(CameraRefused, match=r"every frame by its gamma .*\(Gamma is 0\.8\): switch it off"):
        camera.identify()


def test_a_clock_that_is_asked_by_a_latch_is_waited_for(make_row: MakeRow) -> None:
    row = make_row(2, quirks=frozenset({Quirk.LATCHED_TIME}))
    team = join(row.cameras)
    assert all(camera.wait_for_time(5.0) for camera in row.cameras)
    assert team.synchronised
    together(row.cameras, LABEL)


def test_a_camera_that_takes_no_times_is_triggered_at_once(make_row: MakeRow) -> None:
    """Bit 14 of the capabilities, counted from the left, says that it takes them."""
    row = make_row(2)
    memory = row.devices[0]._memory
    memory.put(Bootstrap.CAPABILITY, memory.get(Bootstrap.CAPABILITY) & ~(1 << 31 - 14))
    team = join(row.cameras)
    assert [camera.wait_for_time(0.5) for camera in row.cameras] == [False, True]
    assert not team.synchronised


def test_chunks_that_are_not_understood_cost_one_frame(make_row: MakeRow) -> None:
    row = quirky(make_row)
    (camera,), (device,) = row.cameras, row.devices
    sent = device.sender.frame
    lengths = []

    def damaged(image, *more):  # type: ignore[no-untyped-def]
        lengths.append(len(image.payload))
        if image.chunked:
            object.__setattr__(image, "payload", image.payload[:-4] + b"\xff" * 4)
        sent(image, *more)

    device.sender.frame = damaged
    with pytest.raises(ChunksRefused, match="do not add up"):
        shoot(camera)
    assert shoot(camera).pixels.shape == (48, 64)
    camera.close()
    assert shoot(camera).pixels.shape == (48, 64)
    assert lengths[1] == lengths[2] == lengths[0] - 24


def redirect(row: Row, url: str) -> None:
    row.devices[0]._memory.put_bytes(Bootstrap.FIRST_URL, url.encode().ljust(URL_SIZE, b"\0"))


def description(row: Row, make_row: MakeRow) -> bytes:
    """The archive as it lies in the camera."""
    device = row.devices[0]
    url = device._memory.read(Bootstrap.FIRST_URL, URL_SIZE).split(b"\0")[0].decode()
    _, begin, size = url.split(";")
    return bytes(device._memory.read(int(begin, 16), int(size, 16)))


def test_a_description_in_a_file_of_this_host_is_read(make_row: MakeRow, tmp_path: Path) -> None:
    row = make_row()
    file = tmp_path / "of the maker.zip"
    file.write_bytes(description(row, make_row))
    redirect(row, "File:simulated.zip")
    with pytest.raises(CameraRefused, match=r"a description on this host, .* which does not exist"):
        row.cameras[0].identify()
    redirect(row, f"File:///{str(file).lstrip('/').replace(' ', '%20')}?SchemaVersion=1.1.0")
    assert np.array_equal(shoot(row.cameras[0]).pixels, shoot(row.twins[0]).pixels)


def test_a_description_at_the_camera_is_read_and_none_from_elsewhere(make_row: MakeRow) -> None:
    row = make_row()
    address, data = row.devices[0].address, description(row, make_row)

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(302 if self.path == "/moved.zip" else 200)
            self.send_header("Location", f"http://{address}:1/simulated.zip")
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, *words: object) -> None:
            pass

    with HTTPServer((address, 0), Page) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        for host, name, why in (
            ("203.0.113.7", "simulated.zip", "does not load any over the network"),
            (address, "moved.zip", "cannot be read .*302"),
        ):
            redirect(row, f"http://{host}:{server.server_port}/{name}")
            with pytest.raises(CameraRefused, match=why):
                row.cameras[0].identify()
        redirect(row, f"http://{address}:{server.server_port}/simulated.zip")
        assert row.cameras[0].identify().make == "hdr-rig"
        server.shutdown()
        thread.join()


def test_writes_of_any_length_need_no_command_of_their_own(make_row: MakeRow) -> None:
    (camera,) = quirky(make_row, Quirk.NO_WRITE_MEMORY).cameras
    camera.identify()
    assert camera._session is not None
    control = camera._session.control
    assert isinstance(control, ControlChannel)
    control.write(0x10088, struct.pack(">d", 4000.0))
    # It goes to the nearest of its own steps.
    assert struct.unpack(">d", control.read(0x10088, 8)) == (1e6 * MEANT.time,)
