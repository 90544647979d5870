"""Camera parameters in the files: noise, colour, and a first guess of the focal length."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from calib.sensor.focal_length import FocalLength, focal_length, rig_focal_length
from calib.sensor.measure import MeasuredSensor
from calib.sensor.rungs import rungs as sensor_rungs
from imaging.errors import InputError
from imaging.files.photo import read_metadata
from imaging.files.raw import read_raw
from imaging.optics.lens import Lens
from imaging.sensor.mosaic import Matrix
from imaging.sensor.noise import SensorNoise
from imaging.sensor.sensor_calibration import at_iso
from imaging.session.calibration import colour_rung
from imaging.session.records import CameraRecord, Rung, ShotRecord
from imaging.session.session import Session

GUESSED_FOCAL = 1.2
"""Focal length guessed where no file states it, in image widths (or heights, if larger)."""


@dataclass(frozen=True)
class CameraSensor:
    """Camera as its files describe it, and the measurements beyond that.

    noise: measured at the ISO of its shots, else from the DNG NoiseProfile; camera_from_rec709: from
    ColorMatrix; lens: no distortion, the focal length guessed; focal: that of a file, or of the rig file.
    """

    noise: SensorNoise | None
    camera_from_rec709: Matrix | None
    lens: Lens
    focal: FocalLength | None
    measured: MeasuredSensor = field(default_factory=MeasuredSensor)
    white_change: float | None = None
    """Relative change of the row of W when it was measured; None without a measurement or without W."""


def describe(session: Session, camera: CameraRecord, shot: ShotRecord) -> CameraSensor:
    """Read one shot of a camera; InputError if it is missing, damaged or not of the recorded size."""
    path = session.file(shot)
    noise = colour = None
    if camera.kind == "raw":
        raw = read_raw(path)
        metadata = raw.metadata
        height, width = raw.pixels.shape[:2]
        if (width, height) != (shot.width, shot.height):
            raise InputError(
                f"{path} has {width}x{height} pixels, its record says {shot.width}x{shot.height}: "
                "restore the file or run `rig check --repair`."
            )
        noise, colour = raw.noise, raw.camera_from_rec709
    else:
        metadata = read_metadata(path)
    focal = focal_length(metadata, shot.width, shot.height) or rig_focal_length(camera)
    guess = GUESSED_FOCAL * max(shot.width, shot.height) if focal is None else focal.px
    lens = Lens(
        model="SIMPLE_RADIAL",
        width=shot.width,
        height=shot.height,
        fx=guess,
        fy=guess,
        cx=shot.width / 2,
        cy=shot.height / 2,
    )
    return CameraSensor(noise, colour, lens, focal)


def with_measured(sensor: CameraSensor, measured: MeasuredSensor, iso: float | None) -> CameraSensor:
    """The sensor with the noise that was measured at the ISO of its shots, if any was."""
    sensor_at = at_iso(measured.at, iso)
    noise = None if sensor_at is None else sensor_at.noise()
    return replace(sensor, measured=measured, noise=noise or sensor.noise)


def rungs(sensors: Mapping[str, CameraSensor]) -> tuple[Rung, ...]:
    """Return where noise and colour come from; sensors: of the cameras that gave RAW, no others have any."""
    noisy = sum(sensor.noise is not None for sensor in sensors.values())
    total = len(sensors)
    if not total:
        return ()
    return (
        *sensor_rungs({name: sensor.measured for name, sensor in sensors.items()}, noisy, total),
        colour_rung([sensor.camera_from_rec709 for sensor in sensors.values()]),
    )
