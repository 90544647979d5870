"""The simulated camera: driven by us, and by hosts that others wrote, Aravis and viva-genicam."""

import re
import shutil
import socket
import struct
import subprocess
import time

import numpy as np
import pytest

from drivers.camera import Camera
from drivers.gige import GigeCamera, Network
from drivers.gige.control import ControlChannel
from drivers.gige.gvcp import PORT, Answer, Code, Command, Status
from drivers.gige.network import Interface
from drivers.gige.registers import Bootstrap
from drivers.sim.gige.memory import PACKET_SIZES
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import raw_shot

from .fakes import ARAVIS, only_at, port_of_aravis
from .rows import MakeRow

LABEL = Exposure(time=1 / 250, iso=200)


def shoot(camera: Camera, exposure: Exposure = LABEL) -> RawMosaic:
    return raw_shot(camera, exposure)


@pytest.mark.parametrize(("bits", "extended"), [(12, False), (14, True)])
def test_a_frame_is_what_the_sensor_saw(make_row: MakeRow, bits: int, extended: bool) -> None:
    row = make_row(bits=bits, extended_ids=extended)
    (camera,), (device,), (twin,) = row.cameras, row.devices, row.twins
    for _ in range(2):
        frame, truth = shoot(camera), shoot(twin)
        assert np.array_equal(frame.pixels, truth.pixels)
        assert (frame.cfa, frame.white) == (truth.cfa, truth.white)
        # As its chunk says, not as it is labelled.
        assert frame.metadata.exposure == Exposure(time=2.0**-8, iso=200)
        assert frame.metadata.opened == pytest.approx(device.opened[-1], abs=0.02)
    assert camera._session is not None
    assert camera._session.stream.packet_size == 9000


def test_a_bracket_by_the_camera_itself(make_row: MakeRow) -> None:
    (camera,), (twin,) = (row := make_row()).cameras, row.twins
    exposures = [Exposure(time=time, iso=100) for time in (1 / 1000, 1 / 250, 1 / 60)]
    for frame, exposure in zip(camera.bracket(exposures), exposures, strict=True):
        assert np.array_equal(frame.pixels, shoot(twin, exposure).pixels)


def test_every_frame_of_every_camera_is_whole_where_one_packet_in_twenty_is_lost(make_row: MakeRow) -> None:
    row = make_row(3)
    for camera in row.cameras:
        camera.identify()
        assert camera._session is not None
        camera._session.nodes.set("GevSCPSPacketSize", 576)
        camera._session.stream.packet_size = 576
    row.lose(0.05)
    for _ in range(6):
        for camera in row.cameras:
            camera.set_exposure(LABEL)
            camera.arm()
        for camera in row.cameras:
            camera.trigger()
        for camera, twin in zip(row.cameras, row.twins, strict=True):
            frame = camera.collect()
            assert np.array_equal(frame.pixels, shoot(twin).pixels)
    row.lose(0.0)
    # A frame is twelve packets: that none of all 216 is lost happens once in 60,000 runs.
    assert sum(device.sender.lost for device in row.devices) > 0


def test_cameras_are_found_by_broadcast(make_row: MakeRow, monkeypatch: pytest.MonkeyPatch) -> None:
    """A broadcast on loopback reaches one simulated camera, and Aravis's fake where another test runs it."""
    row = make_row(2)
    first = row.devices[0]
    with port_of_aravis():
        discovered = Network([], [Interface("127.0.0.1", first.address)]).discover()
    assert [(about.address, about.serial) for about in discovered] == [(first.address, first.serial)]


def ask(address: str, command: Command) -> Answer:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(5)
        link.sendto(command.pack(), (address, PORT))
        return Answer.parse(link.recv(2048))


def test_what_a_host_may_not_do_is_refused(make_row: MakeRow) -> None:
    row = make_row()
    address = row.devices[0].address
    take = struct.pack(">II", Bootstrap.CONTROL_PRIVILEGE, 2)
    size = struct.pack(">II", Bootstrap.STREAM_PACKET_SIZE, 1500)
    assert ask(address, Command(Code.WRITE_REGISTER, 1, size)).status == Status.ACCESS_DENIED
    row.cameras[0].identify()
    assert ask(address, Command(Code.WRITE_REGISTER, 2, take)).status == Status.ACCESS_DENIED
    for code, payload, status in (
        (Code.READ_MEMORY, struct.pack(">IHH", 0x200, 0, 540), Status.BAD_ALIGNMENT),
        (Code.READ_MEMORY, struct.pack(">IHH", 0x201, 0, 4), Status.BAD_ALIGNMENT),
        (Code.READ_MEMORY, b"123", Status.INVALID_PARAMETER),
        (Code.READ_REGISTER, struct.pack(">I", 0xFFFFFFF0), Status.INVALID_ADDRESS),
        (0x4444, b"", Status.NOT_IMPLEMENTED),
    ):
        assert ask(address, Command(code, 3, payload)).status == status, (code, payload)
    assert camera_control(row.cameras[0]).read_number(Bootstrap.CONTROL_PRIVILEGE, 4) == 2
    assert (
        PACKET_SIZES[0]
        <= camera_control(row.cameras[0]).read_number(Bootstrap.STREAM_PACKET_SIZE, 4) & 0xFFFF
    )


def camera_control(camera: GigeCamera) -> ControlChannel:
    assert camera._session is not None
    return camera._session.control


def test_a_command_that_is_sent_again_is_done_once(make_row: MakeRow) -> None:
    """The answer comes again; a trigger that is repeated exposes no second frame."""
    row = make_row()
    (device,) = row.devices
    take = Command(Code.WRITE_REGISTER, 7, struct.pack(">II", Bootstrap.CONTROL_PRIVILEGE, 2)).pack()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(5)
        for _ in range(2):
            link.sendto(take, (device.address, PORT))
            answer = Answer.parse(link.recv(2048))
            assert (answer.status, answer.request_id) == (0, 7)


def test_a_host_that_falls_silent_is_let_go(make_row: MakeRow) -> None:
    row = make_row()
    (device,) = row.devices
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(5)
        for number, (register, value) in enumerate(((Bootstrap.CONTROL_PRIVILEGE, 2), (0x938, 500))):
            payload = struct.pack(">II", register, value)
            link.sendto(Command(Code.WRITE_REGISTER, 1 + number, payload).pack(), (device.address, PORT))
            assert Answer.parse(link.recv(2048)).status == 0
        assert device._memory.controlled
        began = time.monotonic()
        while device._memory.controlled and time.monotonic() < began + 5:
            only_at(device.address).discover()
        assert time.monotonic() - began > 0.4
    assert not device._memory.controlled
    assert shoot(row.cameras[0]).pixels.shape == (48, 64)


def aravis(tool: str) -> str:
    path = shutil.which(f"{tool}-0.8") or shutil.which(f"{tool}-0.10")
    if path is None:
        pytest.skip(f"Aravis ({tool}) is not installed")
    return path


def test_aravis_reads_and_sets_features(make_row: MakeRow) -> None:
    tool, address = aravis("arv-tool"), make_row().devices[0].address

    def control(*words: str) -> str:
        command = [tool, "-a", address, "control", *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout

    output = control(
        "TriggerMode=Off", "TriggerSource=Action0", "ExposureTime=4000", "Gain=6.02", "TriggerSource"
    )
    assert "TriggerSource = Action0" in output
    assert "ExposureTime = 3906.25 us min:122.07 max:3.2e+07" in output
    assert re.search(r"Gain = 6\.0\d+ dB min:0 max:24\.", output)
    output = control("DeviceSerialNumber", "GevSCPSPacketSize=576", "PtpStatus", "ActionGroupMask=3")
    assert "DeviceSerialNumber = SIM-RAW-001" in output
    assert "GevSCPSPacketSize = 576 min:576 max:16000" in output
    assert "PtpStatus = Disabled" in output
    assert "ActionGroupMask = 3" in output


@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_aravis_streams_without_a_failure(make_row: MakeRow, loss: float) -> None:
    """One packet in twenty is lost, and everything that Aravis asks for again comes."""
    tool = aravis("arv-camera-test")
    row = make_row(extended_ids=bool(loss))
    (device,) = row.devices
    device.sender.loss = loss
    command = [tool, "-n", device.address, "--duration=2", "-i", "576", "-e", "2000"]
    output = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30).stdout
    count = {name: int(number) for name, number in re.findall(r"^(n_\w+) += (\d+)$", output, re.MULTILINE)}
    assert count["n_completed_buffers"] >= 20
    assert count["n_size_mismatch_errors"] == count["n_error_packets"] == 0
    if loss:
        assert count["n_resent_packets"] > 0
        assert device.sender.lost > 0
        # What is under way when it stops is not complete.
        assert count["n_failures"] <= 2
    else:
        assert count["n_failures"] == count["n_missing_packets"] == 0


def test_viva_streams_what_the_sensor_saw(make_row: MakeRow) -> None:
    viva = pytest.importorskip("viva_genicam", reason="the package viva-genicam is not installed")
    with port_of_aravis():
        row = make_row(addresses=(ARAVIS,))
        (discovered,) = viva.discover(all=True)
        assert (discovered.ip, discovered.manufacturer, discovered.model) == (
            ARAVIS,
            "hdr-rig",
            "Simulated RAW",
        )
        with viva.connect_gige(discovered) as camera:
            assert camera.get("DeviceSerialNumber") == "SIM-RAW-001"
            camera.set_enum("PixelFormat", "BayerRG8")
            camera.set_enum("AcquisitionMode", "Continuous")
            camera.set_exposure_time(3906.25)
            camera.set_gain(20 * np.log10(2))
            with camera.stream() as frames:
                frame = next(iter(frames))
                pixels, block = frame.to_numpy(), frame.block_id
    truth = shoot(row.twins[0])
    for _ in range(block - 1):
        truth = shoot(row.twins[0])
    assert np.array_equal(pixels, truth.pixels >> 4)
