"""One shot of any kind as linear light: signal, exposure scale, masks and noise, ready to be merged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np

from imaging.arrays import Array32, Floats, Mask
from imaging.colour.spaces import srgb_decode
from imaging.compute.jit import kernel
from imaging.files.photo import read_photo
from imaging.files.radiance_hdr import read_light
from imaging.files.raw import read_raw
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.sensor.sensor_calibration import Levels, SensorCalibration, at_iso
from imaging.session.calibration import Response
from imaging.session.records import ImageKind

SATURATED_CODE = 254 / 255
DARK_CODE = 1 / 255
_TABLE = 65_536
"""Entries of the tables that stand in for curves: one for each code of 16 bits."""
CODE_NOISE = 1 / 255
"""Standard deviation assumed of a developed code value: sensor noise, compression and rounding together."""


class Noise(Protocol):
    """Noise model of a linear signal."""

    def variance(self, mean: Floats) -> Floats:
        """Variance of the signal where its mean is `mean`; same shape, or broadcast to it; positive."""
        ...


@dataclass(frozen=True)
class SensorSignalNoise:
    """Shot and read noise of a signal in 0..1, as a DNG NoiseProfile: `slope * mean + floor`.

    shares: by what this is multiplied in each channel of a signal [..., channels]; None: 1.
    """

    slope: float
    floor: float
    shares: tuple[float, ...] | None = None

    def variance(self, mean: Floats) -> Floats:
        """Variance at a mean signal; a negative mean counts as black."""
        variance = np.asarray(self.slope * np.maximum(mean, 0.0) + self.floor)
        return variance if self.shares is None else variance * np.asarray(self.shares, np.float32)


class CodeSignalNoise:
    """Noise of light decoded from code values: `CODE_NOISE` times the slope of the decoding curve."""

    def __init__(self, response: Response) -> None:
        codes = np.linspace(0.0, 1.0, 256)
        light = decode(np.repeat(codes[:, None], 3, axis=1), response).astype(np.float64).T
        variance = np.maximum(CODE_NOISE * np.gradient(light, codes, axis=1), 1e-9) ** 2
        # Looked up by the square root of the light, in which every curve is sampled evenly enough.
        self._top = np.sqrt(np.maximum(light[:, -1], 1e-30)).astype(np.float32)
        places = np.linspace(0.0, 1.0, _TABLE)
        self._table = np.stack(
            [
                np.interp((places * top) ** 2, levels, spread).astype(np.float32)
                for top, levels, spread in zip(self._top, light, variance, strict=True)
            ],
            axis=-1,
        )

    def variance(self, mean: Floats) -> Floats:
        """Variance at a mean signal [..., 3]."""
        variance = np.empty(mean.shape, np.float32)
        _look_up_roots(mean.reshape(-1, 3), 1 / self._top, self._table, variance.reshape(-1, 3))
        return variance


@lru_cache(maxsize=16)
def code_noise(response: Response) -> CodeSignalNoise:
    """The noise of a response; its table is held once for all photographs."""
    return CodeSignalNoise(response)


@dataclass(frozen=True, eq=False)
class LinearFrame:
    """One exposure, linear: `signal = radiance * k` where nothing is clipped.

    signal: float32 [H, W] (mosaic, black 0 and white 1, noise below black negative) or [H, W, 3].
    k: exposure scale, s. saturated: bool, same shape: the scene is at least this bright.
    dark: bool, the scene is at most this bright (code values at their lower end). valid: bool, False
    where the file holds no number. cfa: of a mosaic. noise: None if not known. ceiling: the
    signal at which the sensor saturates, where that is one number.
    """

    signal: Array32
    k: float
    saturated: Mask
    dark: Mask
    valid: Mask
    cfa: Cfa | None = None
    noise: Noise | None = None
    ceiling: float | None = None


def read_linear(
    path: Path,
    kind: ImageKind,
    k: float,
    response: Response,
    sensors: Sequence[SensorCalibration] = (),
) -> LinearFrame:
    """Read a file of a session as linear light.

    Args:
        path: File.
        kind: Kind of the camera (`CameraRecord.kind`). Light (`hdr`) is taken as it is.
        k: Exposure scale, s.
        response: Response of the camera's calibration, which only code values (`ldr`) need.
        sensors: Measured sensors of the camera's calibration, by ISO, for RAW.

    Returns:
        The exposure: [H, W] of a RAW mosaic, else [H, W, 3].

    Raises:
        InputError: The file is missing or damaged.
    """
    if kind == "raw":
        return from_raw(read_raw(path), k, sensors)
    if kind == "ldr":
        return from_codes(read_photo(path).pixels, k, response)
    return from_light(read_light(path), k)


def from_raw(raw: RawMosaic, k: float, sensors: Sequence[SensorCalibration] = ()) -> LinearFrame:
    """Read the black-subtracted mosaic, with the levels measured at its ISO, else those of the file.

    The signal is 1 at the file's white level, wherever the sensor saturates (`saturated`, `ceiling`). A
    response that was found bent is straightened. Without a measurement the noise is that of the file's
    NoiseProfile, if it has one.
    """
    iso = raw.metadata.exposure.iso if raw.metadata.exposure else None
    measured = at_iso(sensors, iso)
    levels = Levels() if measured is None else measured.levels()
    if levels.black is not None:
        raw = replace(raw, black=levels.black)
    signal, black = levels.straight(raw.signal()), float(np.mean(raw.black))
    top = raw.white if levels.white is None else min(levels.white, raw.white)
    profile = raw.noise_profile if levels.noise is None else levels.noise.profile(black, raw.white)
    noise = None if profile is None else SensorSignalNoise(*profile, raw.noise_shares)
    return LinearFrame(
        signal,
        k,
        saturated=raw.pixels >= top,
        dark=np.zeros(signal.shape, bool),
        valid=_valid(levels, signal),
        cfa=raw.cfa,
        noise=noise,
        ceiling=float(levels.straight(np.array((top - black) / (raw.white - black), np.float32))),
    )


def _valid(levels: Levels, signal: Array32) -> Mask:
    """Return where no defect is, of the shape of the signal."""
    valid = levels.valid(*signal.shape[:2])
    return valid if signal.ndim == 2 else np.repeat(valid[..., None], signal.shape[2], axis=2)


def from_codes(codes: Floats, k: float, response: Response) -> LinearFrame:
    """Code values [H, W, 3] in 0..1 decoded by a response; codes that it was not measured at are clipped.

    A code at either end of the scale, or beyond the measured part of the curve, only bounds the light.
    """
    low, high = response.valid if response.kind == "curve" else (0.0, 1.0)
    # The codes of 8 and of 16 bits all lie on this grid, so that a look-up is exact, and many times faster.
    grid = np.linspace(0.0, 1.0, _TABLE)
    table = decode(np.repeat(grid[:, None], 3, axis=1), response)
    signal = np.empty(codes.shape, np.float32)
    _look_up(codes.reshape(-1, 3), table, signal.reshape(-1, 3))
    return LinearFrame(
        signal,
        k,
        saturated=codes >= min(SATURATED_CODE, high),
        dark=codes <= max(DARK_CODE, low),
        valid=np.ones(codes.shape, bool),
        noise=code_noise(response),
    )


@kernel
def _look_up(codes: Floats, table: Array32, out: Array32) -> None:
    """Write the entries of a table [T, 3] of 0..1 that are nearest to codes [N, 3] into found [N, 3]."""
    last = len(table) - 1
    for row in range(len(codes)):
        for channel in range(3):
            code = codes[row, channel]
            place = int(min(code, 1.0) * last + 0.5) if code > 0 else 0
            out[row, channel] = table[place, channel]


@kernel
def _look_up_roots(light: Floats, scale: Array32, table: Array32, out: Array32) -> None:
    """The same by the square root of light [N, 3], in units of 1 / scale [3]."""
    last = len(table) - 1
    for row in range(len(light)):
        for channel in range(3):
            value = light[row, channel]
            root = np.sqrt(value) * scale[channel] if value > 0 else 0.0
            out[row, channel] = table[int(min(root, 1.0) * last + 0.5), channel]


def from_light(light: Floats, k: float) -> LinearFrame:
    """Linear light [H, W, 3]; NaN and infinities are marked as no number."""
    valid = np.isfinite(light)
    none = np.zeros(light.shape, bool)
    return LinearFrame(np.where(valid, light, 0).astype(np.float32), k, none, none, valid)


def decode(codes: Floats, response: Response) -> Array32:
    """Code values [..., 3] in 0..1 to linear light times exposure scale, float32 [..., 3].

    A measured curve holds ln E + ln k at its codes. Below the lowest of them the light falls in
    proportion to the code, since a code of 0 has no logarithm; above the highest it stays.
    """
    if response.kind == "linear":
        return np.asarray(codes, np.float32)
    if response.kind == "srgb":
        return np.asarray(srgb_decode(codes), np.float32)
    nodes = np.asarray(response.codes, np.float64)
    light = np.empty(codes.shape, np.float32)
    for channel, curve in enumerate(response.log_exposure):
        code = codes[..., channel]
        toe = np.clip(code / nodes[0], 0.0, 1.0) if nodes[0] > 0 else 1.0
        light[..., channel] = np.exp(np.interp(code, nodes, curve)) * toe
    return light
