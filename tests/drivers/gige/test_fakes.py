"""Our driver on cameras that others wrote: Aravis's fake camera, and that of viva-genicam."""

import socket
import struct
import time

import numpy as np
import numpy.typing as npt
import pytest

from drivers.camera import Camera
from drivers.clock import SystemClock
from drivers.errors import CameraClaimed, CameraLost, CameraNotFound, CameraProtocol
from drivers.gige import GigeCamera
from drivers.gige.control import ControlChannel
from drivers.gige.gvcp import PORT, Code, Command
from drivers.gige.registers import About, Bootstrap
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import raw_shot

from .fakes import aravis_fake, camera_at, only_at, own_address, viva_fake

TENTH = Exposure(time=0.01)


def shoot(camera: Camera, exposure: Exposure = TENTH) -> RawMosaic:
    return raw_shot(camera, exposure)


def ramp(block: int, shape: tuple[int, int]) -> npt.NDArray[np.uint16]:
    """The test picture of viva's camera in Mono16: byte k of frame n is 7 k + n."""
    count = 2 * shape[0] * shape[1]
    return ((7 * np.arange(count) + block) % 256).astype(np.uint8).view("<u2").reshape(shape)


def test_aravis_camera_from_discovery_to_pixels() -> None:
    """Its picture is a ramp along both axes, (x + y + number of the frame) modulo 255 at 10 ms."""
    with aravis_fake() as address:
        assert only_at(address).discover() == [About(address, "GV01", "Aravis", "Fake")]
        camera = camera_at(address)
        assert (camera.serial, camera.where) == ("GV01", f"GigE {address}")
        identity, able = camera.identify(), camera.capabilities()
        assert camera._session is not None
        camera._session.nodes.set("PixelFormat", "Mono8")  # its mosaic is a ramp for each colour
        frames = [shoot(camera) for _ in range(3)]
        brighter = shoot(camera, Exposure(time=0.1))
        camera.close()
    assert (identity.serial, identity.make, identity.model) == ("GV01", "Aravis", "Fake")
    assert (able.width, able.height, able.bit_depth) == (512, 512, 8)
    assert (able.times[0], able.times[-1]) == pytest.approx((10e-6, 10.0))
    y, x = np.mgrid[:512, :512]
    for frame in frames:
        assert np.array_equal(frame.pixels, (x + y + frame.pixels[0, 0]) % 255)
        assert (frame.cfa, frame.white) == (Cfa.MONO, 255)
        assert frame.metadata.exposure == TENTH
    assert len({int(frame.pixels[0, 0]) for frame in frames}) == 3
    # Ten times the exposure is 1 + log10(10) times as bright there.
    ramped = (x + y + frames[-1].pixels[0, 0].astype(int) + 1) % 255
    assert np.array_equal(brighter.pixels, np.minimum(2 * ramped, 255))
    assert brighter.metadata.exposure == Exposure(time=0.1)


def test_packets_that_a_camera_cannot_send_again_are_named_and_the_next_frame_is_whole() -> None:
    """Aravis's camera loses packets and knows no resend: one in twenty of 190 spoils every frame."""
    with aravis_fake("-r", "50") as address:
        camera = camera_at(address)
        with pytest.raises(CameraProtocol, match=r"incomplete \(packets were lost, .*shoot it again"):
            shoot(camera)
        camera.close()
    with aravis_fake() as address:
        assert shoot(camera).pixels.shape == (512, 512)
        camera.close()


def test_viva_camera_from_discovery_to_pixels() -> None:
    with viva_fake() as fake:
        camera = camera_at(fake.ip)
        frames = [shoot(camera, Exposure(time=0.02)) for _ in range(3)]
        assert fake.controller() is not None
        assert fake.software_triggers() == 3
        camera.close()
        assert fake.controller() is None
        assert fake.blocks_sent() == 3
    for number, frame in enumerate(frames):
        assert np.array_equal(frame.pixels, ramp(1 + number, (96, 128)))
        assert (frame.cfa, frame.white) == (Cfa.MONO, 65535)
        assert frame.metadata.exposure == Exposure(time=0.02)  # its Gain has no unit


@pytest.mark.parametrize("lost", [(0,), (3,), (2, 4, 5), (0, 1, 2), (16, 17), (17, 18), tuple(range(10, 19))])
def test_viva_camera_sends_again_what_was_lost(lost: tuple[int, ...]) -> None:
    """24576 bytes in packets of 1464 are 17: the leader is 0, the trailer 18."""
    with viva_fake(drop_packets=[(1, number) for number in lost]) as fake:
        camera = camera_at(fake.ip)
        frame = shoot(camera)
        camera.close()
    assert np.array_equal(frame.pixels, ramp(1, (96, 128)))


def test_a_camera_without_resend_costs_the_frame_alone() -> None:
    with viva_fake(packet_resend=False, drop_packets=[(1, 2)]) as fake:
        camera = camera_at(fake.ip)
        camera.set_exposure(TENTH)
        camera.arm()
        camera.trigger()
        with pytest.raises(CameraProtocol, match="packets were lost, 1 at least"):
            camera.collect()
        camera.close()


def test_a_slow_answer_is_waited_for() -> None:
    """0.6 s: it is asked twice more by then, and answers to all by the same number."""
    with viva_fake(delay_ack={0x20030: 0.6}) as fake:
        assert fake.REGISTERS["ExposureTime"] == 0x20030
        camera = camera_at(fake.ip)
        applied = camera.set_exposure(TENTH)
        assert struct.unpack(">d", fake.peek(0x20030, 8)) == (10_000.0,)
        camera.close()
    assert applied.time == 0.01


def test_a_camera_that_another_program_holds_is_told() -> None:
    with viva_fake() as fake, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        take = struct.pack(">II", Bootstrap.CONTROL_PRIVILEGE, 1)
        other.settimeout(5)
        other.sendto(Command(Code.WRITE_REGISTER, 1, take).pack(), (fake.ip, PORT))
        other.recv(100)
        with pytest.raises(CameraClaimed, match="is held by another program"):
            camera_at(fake.ip).identify()


def test_a_camera_that_forgets_us_is_set_up_again() -> None:
    with viva_fake() as fake:
        camera = camera_at(fake.ip)
        assert np.array_equal(shoot(camera).pixels, ramp(1, (96, 128)))
        camera.arm()
        fake.revoke_control()
        assert camera._session is not None
        with pytest.raises(CameraLost, match="released control"):
            read_for(camera._session.control, 5.0)
        with pytest.raises(CameraLost, match="released control"):
            camera.trigger()
        assert fake.controller() is None
        assert shoot(camera).metadata.exposure == Exposure(time=0.01)
        camera.close()


def read_for(control: ControlChannel, seconds: float) -> None:
    """Do what anybody may do, again and again."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        control.read(Bootstrap.VERSION, 4)


def test_a_camera_that_is_not_there_is_told() -> None:
    camera = GigeCamera("nobody", only_at(own_address(9)), SystemClock())
    with pytest.raises(CameraNotFound, match="camera nobody does not answer on the network"):
        camera.identify()
