"""Cameras over USB/IP, driven by the very drivers that drive hardware: frames are what the sensor saw."""

from collections.abc import Callable

import numpy as np
import pytest

from drivers import ptp
from drivers.clock import SystemClock
from drivers.sim.faults import Fault, Kind
from drivers.u3v import find_cameras
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure
from tests.drivers.ptp.test_shots import EXPOSURE, same, shot
from tests.drivers.u3v.test_camera import shoot

from .attached import AttachedBus
from .conftest import Served, Toy

Serve = Callable[..., Served]


def test_frames_are_what_the_sensor_saw(serve: Serve, toy: Toy) -> None:
    served = serve(toy.vision())
    twin = toy.make()
    for _ in range(2):  # a client comes back
        attached = AttachedBus(served.address)
        (camera,) = find_cameras(attached, SystemClock())
        assert camera.identify().serial == twin.body.serial
        for exposure in (Exposure(time=1 / 60, iso=200), Exposure(time=1 / 500, iso=100)):
            frame, truth = shoot(camera, exposure), shoot(twin, exposure)
            assert np.array_equal(frame.pixels, truth.pixels)
            assert (frame.cfa, frame.white) == (truth.cfa, truth.white)
        camera.close()
        attached.detach()


@pytest.mark.parametrize("kind", [Kind.STALL, Kind.TIMEOUT, Kind.DROPPED_PAYLOAD, Kind.NO_TRAILER])
def test_a_frame_that_broke_off_is_reported_and_the_next_is_whole(serve: Serve, toy: Toy, kind: Kind) -> None:
    serial = toy.twin.body.serial
    served = serve(toy.vision(Fault(kind, serial, "Frame", count=100)))
    attached = AttachedBus(served.address)
    (camera,) = find_cameras(attached, SystemClock())
    twin = toy.make()
    exposure = Exposure(time=1 / 500, iso=100)
    with pytest.raises(CameraError):
        shoot(camera, exposure)
    shoot(twin, exposure)
    camera.close()
    (camera,) = find_cameras(attached, SystemClock())
    assert np.array_equal(shoot(camera, exposure).pixels, shoot(twin, exposure).pixels)
    camera.close()
    attached.detach()


def test_a_still_camera_shoots_over_it_as_well(serve: Serve, toy: Toy) -> None:
    served = serve(toy.still("nikon-z6"))
    attached = AttachedBus(served.address)
    (camera,) = ptp.find_cameras(attached, SystemClock())
    assert camera.identify().model == "Z 6"
    assert same(shot(camera, EXPOSURE), shot(toy.make(), EXPOSURE))
    camera.close()
    attached.detach()
