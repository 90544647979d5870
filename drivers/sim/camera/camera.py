"""A camera of a simulated rig: the `Camera` protocol over a rendered scene and a simulated sensor."""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from enum import Enum
from typing import Literal

import numpy as np

from drivers.camera import CameraFile, CameraIdentity, Capabilities
from drivers.sim.camera import response, shutter
from drivers.sim.camera.optics import Optics
from drivers.sim.camera.sensor import SensorModel, SimulatedSensor
from drivers.sim.seeds import generator
from imaging.arrays import Array, Floats
from imaging.errors import CameraError
from imaging.files.photo import encode_jpeg
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import FrameMetadata, Matrix, RawMosaic

MAKE = "hdr-rig"
HEADROOM = 4.0
"""Headroom beyond the code 255 of a camera that develops its photographs: the range of the four photosites
binned to a pixel.
"""

_EPOCH = datetime(2026, 1, 1, 12, 0, 0)
_FRAME_SECONDS, _LATENCY = 60.0, 250e-6

View = Callable[[int], Floats]


class _Stage(Enum):
    IDLE = "idle"
    ARMED = "armed"
    EXPOSED = "exposed"
    CLOSED = "closed"


@dataclass(frozen=True)
class Body:
    """Properties of one camera, apart from its place.

    seed: of the rig; nominal: the model that its files claim, which no single sensor keeps exactly.
    """

    seed: int
    serial: str
    kind: Literal["raw", "ldr"]
    optics: Optics
    sensor: SensorModel
    nominal: SensorModel
    cfa: Cfa
    camera_from_xyz: Matrix | None
    curve: response.Curve = "film"
    """Tone curve of developed photographs."""
    effects: bool = False
    """True for shutter jitter, lamp flicker and row noise, which no calibration removes."""


@dataclass
class _Shot:
    """An exposure between trigger and collect."""

    label: Exposure
    frame: int
    step: int
    take: int
    opened: float
    captured_at: datetime = field(default=_EPOCH)


def applied_exposure(body: Body, frame: int, label: Exposure) -> tuple[Exposure, float]:
    """Applied exposure of a frame at the dial setting `label`, and the flicker of the light then."""
    exact = shutter.applied(label)
    if not body.effects:
        return exact, 1.0
    noise = generator(body.seed, body.serial, "shutter", frame, label.time, label.f_number)
    jitter, phase = float(noise.standard_normal()), float(noise.random())
    # Mains at 100 Hz: an exposure sees the mean of the ripple over its own length.
    turns = 100.0 * exact.time
    ripple = (np.sin(2 * np.pi * (phase + turns)) - np.sin(2 * np.pi * phase)) / (2 * np.pi * turns)
    return exact.with_time(exact.time * float(np.exp(0.01 * jitter))), 1.0 + 0.03 * float(ripple)


class SimulatedCamera:
    """Drives like any camera. The same shot gives the same bytes, whatever was shot before it."""

    def __init__(self, body: Body, view: View, clock: Callable[[], float] | None = None) -> None:
        """`view(frame)` is the radiance [H, W, 3] that the camera sees; `clock` gives trigger times.

        Without a clock the times follow from frame, exposure and camera, so that runs can be repeated.
        """
        self.body = body
        self._view, self._clock = view, clock
        self._frame = self._step = 0
        self._takes: dict[Exposure, int] = {}
        self._label = shutter.snap(Exposure(time=1 / 60))
        self._stage = _Stage.IDLE
        self._shot: _Shot | None = None
        self._sensors: list[SimulatedSensor] | None = None

    def place(self, frame: int, step: int = 0) -> None:
        """Set the rig's place; exposures are counted anew from here."""
        self._frame, self._step = frame, step
        self._takes.clear()

    @property
    def where(self) -> str:
        """Empty: it is on no bus."""
        return ""

    def verified(self) -> str:
        """Scope of the verification: the laws that it simulates."""
        return "its own simulation"

    def identify(self) -> CameraIdentity:
        """Return the identity."""
        return CameraIdentity(self.body.serial, MAKE, self._model(), self.body.kind)

    def capabilities(self) -> Capabilities:
        """Return what it can be set to, as labels."""
        lens = self.body.optics.lens
        return Capabilities(
            width=lens.width,
            height=lens.height,
            bit_depth=self.body.sensor.bit_depth if self.body.kind == "raw" else 8,
            times=tuple(sorted(shutter.APPLIED_TIME)),
            f_numbers=tuple(shutter.APPLIED_F_NUMBER),
            isos=shutter.ISOS,
        )

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Turn the dials to the nearest labels and return them; out of range goes to the nearest end."""
        self._must_be(_Stage.IDLE, _Stage.ARMED, to="be set")
        self._label = shutter.snap(exposure)
        self._stage = _Stage.IDLE
        return self._label

    def arm(self) -> None:
        """Make ready to be triggered."""
        self._must_be(_Stage.IDLE, to="be armed")
        self._stage = _Stage.ARMED

    def trigger(self) -> float:
        """Expose; the monotonic time at which the shutter opened, s."""
        self._must_be(_Stage.ARMED, to="be triggered")
        label, body = self._label, self.body
        take = self._takes.get(label, 0)
        self._takes[label] = take + 1
        place = self._frame * _FRAME_SECONDS + 2.0 * self._step + 10.0 * take
        # Later on the dial is later in the minute: a bracket's files sort as it was shot.
        place += 0.1 * sorted(shutter.APPLIED_TIME).index(label.time)
        late = generator(body.seed, body.serial, "latency", self._frame, label.time).random()
        opened = place + _LATENCY * late if self._clock is None else self._clock()
        captured = _EPOCH + timedelta(milliseconds=round(1000 * place))
        self._shot = _Shot(label, self._frame, self._step, take, opened, captured)
        self._stage = _Stage.EXPOSED
        return opened

    def collect(self) -> RawMosaic | CameraFile:
        """The frame that was exposed; only once."""
        self._must_be(_Stage.EXPOSED, to="deliver a frame")
        assert self._shot is not None
        shot, self._shot, self._stage = self._shot, None, _Stage.IDLE
        return self._raw(shot) if self.body.kind == "raw" else self._photo(shot)

    def close(self) -> None:
        """Let go of the camera; a second time does nothing."""
        self._stage = _Stage.CLOSED

    def _must_be(self, *stages: _Stage, to: str) -> None:
        if self._stage not in stages:
            raise CameraError(
                f"camera {self.body.serial} is {self._stage.value} and cannot {to}: "
                "call set_exposure, arm, trigger and collect in this order."
            )

    def _model(self) -> str:
        return "Simulated RAW" if self.body.kind == "raw" else "Simulated JPEG"

    def _metadata(self, shot: _Shot) -> FrameMetadata:
        lens = self.body.optics.lens
        return FrameMetadata(
            make=MAKE,
            model=self._model(),
            serial=self.body.serial,
            exposure=shot.label,
            captured_at=shot.captured_at,
            opened=shot.opened,
            focal_length_mm=round(self.body.optics.sensor_width_mm * lens.fx / lens.width, 2),
        )

    def _electrons(self, shot: _Shot) -> tuple[Array, float]:
        """Mean photo-electrons of every pixel in camera RGB [H, W, 3], and the time applied, s."""
        exact, flicker = applied_exposure(self.body, shot.frame, shot.label)
        # The ISO acts behind the photosites: it does not change what they count.
        light = exact.model_copy(update={"iso": None}).scale * flicker
        return self.body.optics.exposure(self._view(shot.frame)) * (
            light * self.body.sensor.white_electrons
        ), exact.time

    def _noise(self, shot: _Shot, plane: int) -> np.random.Generator:
        label = shot.label
        key = (shot.frame, shot.step, shot.take, label.time, label.f_number, label.iso, plane)
        return generator(self.body.seed, self.body.serial, "frame", *key)

    def _planes(self, count: int) -> list[SimulatedSensor]:
        if self._sensors is None:
            body, lens = self.body, self.body.optics.lens
            self._sensors = [
                SimulatedSensor(body.sensor, lens.width, lens.height, body.seed, body.serial, plane)
                for plane in range(count)
            ]
        return self._sensors

    def _raw(self, shot: _Shot) -> RawMosaic:
        body = self.body
        electrons, time = self._electrons(shot)
        sensor = self._planes(1)[0]
        site = mosaic(electrons, body.cfa)
        pixels = sensor.expose(site, time, shot.label.iso_gain, self._noise(shot, 0))
        neutral = body.optics.neutral
        nominal, span = body.nominal, body.nominal.white - float(np.mean(body.nominal.black))
        gain = nominal.gain * shot.label.iso_gain
        return RawMosaic(
            pixels=pixels,
            cfa=body.cfa,
            black=body.sensor.black,
            white=body.sensor.white,
            neutral=None if body.cfa.mono else tuple(neutral.tolist()),
            camera_from_xyz=body.camera_from_xyz,
            noise_profile=(gain / span, ((gain * nominal.read_noise) ** 2 + 1 / 12) / span**2),
            metadata=self._metadata(shot),
        )

    def _photo(self, shot: _Shot) -> CameraFile:
        """The photograph as the camera's own computer develops it.

        Every pixel has all three colours, from a mosaic of more photosites that it bins.
        """
        body, lens = self.body, self.body.optics.lens
        electrons, time = self._electrons(shot)
        linear = np.empty(electrons.shape)
        for plane, sensor in enumerate(self._planes(3)):
            number = sensor.expose(
                electrons[..., plane] / HEADROOM, time, shot.label.iso_gain, self._noise(shot, plane)
            )
            black = float(np.mean(sensor.model.black))
            linear[..., plane] = (number - black) * HEADROOM / (sensor.model.white - black)
        codes = response.develop(linear @ np.linalg.inv(body.optics.camera_from_rec709).T, body.curve)
        metadata = self._metadata(shot)
        data = encode_jpeg(np.rint(255.0 * codes).astype(np.uint8), 95, metadata)
        return CameraFile(data, ".jpg", lens.width, lens.height, metadata)
