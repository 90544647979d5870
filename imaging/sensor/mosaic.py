"""A RAW frame as it left the sensor, with what is needed to read it as linear light."""

from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array32, Mask
from imaging.colour.spaces import camera_from_rec709
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa, Tile, repeated, rolled
from imaging.sensor.noise import SensorNoise

Matrix = tuple[tuple[float, float, float], ...]
"""A row of three for each channel of a camera."""


def as_matrix(values: npt.ArrayLike) -> Matrix:
    """An array [channels, 3] as the nested tuples that records hold."""
    return tuple((float(x), float(y), float(z)) for x, y, z in np.asarray(values).reshape(-1, 3))


@dataclass(frozen=True)
class GpsPosition:
    """Position in WGS84: latitude and longitude, degrees, and height, m; error: horizontal, and
    altitude_error: of the height, m. None: not stated.
    """

    latitude: float
    longitude: float
    altitude: float | None = None
    error: float | None = None
    altitude_error: float | None = None


@dataclass(frozen=True)
class FrameMetadata:
    """Metadata of a file on its camera and exposure; None where the file is silent.

    captured_at: what the camera's clock showed, without a zone. lens: its name. digital_zoom: by how much the
    picture was cut and enlarged. orientation: as in EXIF, 1 to 8. opened: when the shutter opened, in seconds
    of the clock that the driver was given, for cameras that stamp their frames; no file holds it. unknown:
    what its driver could not learn of the frame and took a value for, a sentence each; in no file. sensor_mm:
    the longer side of what the pixels of the picture cover on the sensor. manual_white_balance: it was set,
    and not chosen by the camera for this frame. balance: by how much the camera raised red and blue over
    green. gimbal: yaw, clockwise from north, pitch, up, and roll of a drone's camera, degrees. height: m
    above where a drone took off.
    """

    make: str = ""
    model: str = ""
    serial: str = ""
    exposure: Exposure | None = None
    captured_at: datetime | None = None
    focal_length_mm: float | None = None
    focal_length_35mm: float | None = None
    lens: str = ""
    digital_zoom: float | None = None
    sensor_mm: float | None = None
    gimbal: tuple[float, float, float] | None = None
    height: float | None = None
    orientation: int = 1
    opened: float | None = None
    unknown: tuple[str, ...] = ()
    position: GpsPosition | None = None
    manual_white_balance: bool = False
    balance: tuple[float, float] | None = None


@dataclass(frozen=True)
class RawMosaic:
    """A mosaic of any colour filter array, mono, or light that was demosaicked before it was stored.

    pixels: uint16 [H, W], DN, as stored, black not subtracted; [H, W, 3] where `cfa` is None. black: DN of
    the sites of a tile that repeats, of its own period. black_offset: float32 [H, W], DN, by which black
    departs from `black` at each photosite, on average 0 over every site of the tile; None: 0 everywhere.
    white: DN at and above which a photosite counts as saturated. neutral: response of each channel to a
    neutral surface, largest 1 (DNG AsShotNeutral); None if unknown. camera_from_xyz: a row for each channel,
    XYZ to camera under D65 (DNG ColorMatrix), scale free; None if unknown. noise_profile: (S, O), variance =
    S * signal + O on 0..1 (DNG NoiseProfile); None if unknown. noise_shares: by how much the variance of each
    channel is greater than that, of light without a CFA; None: equal.
    """

    pixels: npt.NDArray[np.uint16]
    cfa: Cfa | None
    black: Tile
    white: int
    neutral: tuple[float, ...] | None = None
    camera_from_xyz: Matrix | None = None
    noise_profile: tuple[float, float] | None = None
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    black_offset: Array32 | None = None
    noise_shares: tuple[float, ...] | None = None

    @property
    def noise(self) -> SensorNoise | None:
        """Noise model of `noise_profile`, in DN; None without one."""
        if self.noise_profile is None:
            return None
        return SensorNoise.from_profile(self.noise_profile, float(np.mean(self.black)), self.white)

    @property
    def camera_from_rec709(self) -> Matrix | None:
        """Linear Rec.709 to camera, a row a channel, green summing to 1; None if unknown or impossible."""
        try:
            return (
                None if self.camera_from_xyz is None else as_matrix(camera_from_rec709(self.camera_from_xyz))
            )
        except ValueError:  # a matrix that cannot be one is as good as none
            return None

    def black_map(self) -> Array32:
        """Black level of every photosite, DN, float32 [H, W]."""
        level = repeated(np.array(self.black, np.float32), *self.pixels.shape[:2])
        return level if self.black_offset is None else level + self.black_offset

    def signal(self) -> Array32:
        """Linear signal, black 0 and white 1, float32 [H, W]; noise below black stays negative."""
        black = self.black_map() if self.pixels.ndim == 2 else self.black_map()[..., None]
        return ((self.pixels.astype(np.float32) - black) / (self.white - black)).astype(np.float32)

    def saturated(self) -> Mask:
        """Photosites at or above white, bool [H, W]."""
        return self.pixels >= self.white

    def cropped(self, top: int, left: int, height: int, width: int) -> "RawMosaic":
        """A window of the mosaic; phase and black levels shift with it."""
        rows, columns = slice(top, top + height), slice(left, left + width)
        offset = None if self.black_offset is None else self.black_offset[rows, columns]
        return replace(
            self,
            pixels=np.ascontiguousarray(self.pixels[rows, columns]),
            cfa=None if self.cfa is None else self.cfa.cropped(top, left),
            black=rolled(self.black, top, left),
            black_offset=offset,
        )
