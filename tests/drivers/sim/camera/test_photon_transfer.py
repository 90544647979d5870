"""Gain and read noise found again in frames that came over the bus (EMVA 1288 photon transfer)."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from drivers.camera import Camera
from drivers.discovery import find_cameras
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.port import Device
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.files.raw import decode_raw
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import shot

TIMES = (1 / 500, 1 / 125, 1 / 60, 1 / 30, 1 / 15, 1 / 8)


def pair(camera: Camera, time: float) -> tuple[np.ndarray, np.ndarray]:
    frames = []
    for _ in range(2):
        frame = shot(camera, Exposure(time=time, f_number=4.0, iso=100.0))
        mosaic = frame if isinstance(frame, RawMosaic) else decode_raw(frame.data, frame.suffix)
        frames.append(mosaic.pixels.astype(np.float64))
    return frames[0], frames[1]


def half_variance(difference: np.ndarray) -> float:
    """Half the variance of a difference of two frames, without hot pixels, which are far out."""
    spread = 1.4826 * np.median(np.abs(difference - np.median(difference)))
    return float(np.var(difference[np.abs(difference) < 6 * spread + 1]) / 2)


@pytest.mark.parametrize("protocol", ["PTP", "USB3 Vision"])
def test_photon_transfer_gives_back_what_the_sensor_is(protocol: str) -> None:
    """Both within 2 %; pairs of frames, whose difference knows nothing of PRNU, DSNU and vignetting."""
    rig = simulate("demo", seed=4)
    body, lens = rig.bodies[0], rig.bodies[0].optics.lens
    light = {"level": 0.0}
    flat: Callable[[int], np.ndarray] = lambda frame: np.full(  # noqa: E731
        (lens.height, lens.width, 3), light["level"], np.float32
    )
    clock = VirtualClock()
    bus, device = VirtualBus(clock), SimulatedCamera(body, flat)
    plugged: Device = (
        PtpDevice(Responder(device, profile("generic"), clock))
        if protocol == "PTP"
        else U3vDevice(device, clock)
    )
    bus.plug(plugged)
    (camera,) = find_cameras(bus, clock)
    gain, read_noise, black = body.sensor.gain, body.sensor.read_noise, body.sensor.black

    first, second = pair(camera, TIMES[0])  # no light
    dark = [half_variance(first - second)]
    # As bright as two thirds of the well at the longest time, over all colours.
    light["level"] = 1.0
    probe, _ = pair(camera, TIMES[0])
    per_unit = float(np.quantile(probe, 0.99) - np.mean(black)) / TIMES[0]
    light["level"] = 0.66 * body.sensor.white / (per_unit * TIMES[-1])
    mean, variance, weight = [0.0], dark, [first.size]
    for time in TIMES:
        first, second = pair(camera, time)
        level = (first + second) / 2 - np.tile(np.array(black), np.array(first.shape) // 2)
        good = (first < 0.95 * body.sensor.white) & (second < 0.95 * body.sensor.white)
        edges = np.quantile(level[good], np.linspace(0, 1, 13))
        for low, high in pairwise(edges):
            inside = good & (level >= low) & (level < high)
            if inside.sum() > 1000:
                mean.append(float(level[inside].mean()))
                variance.append(half_variance((first - second)[inside]))
                weight.append(int(inside.sum()))
    x, y, n = np.array(mean), np.array(variance), np.array(weight, float)
    # The variance of a variance is 2 var^2 / n.
    slope, intercept = np.polyfit(x, y, 1, w=np.sqrt(n) / y)
    assert slope == pytest.approx(gain, rel=0.02)
    assert np.sqrt(intercept - 1 / 12) / slope == pytest.approx(read_noise, rel=0.02)
    camera.close()
