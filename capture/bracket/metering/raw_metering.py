"""The meter's view of a camera that delivers RAW frames: see capture.bracket.metering.meter."""

import math
from dataclasses import replace
from math import lcm

import numpy as np

from capture.bracket.metering.percentile import (
    BRIGHT_PERCENTILE,
    BRIGHT_SHARE,
    DARK_PERCENTILE,
    TAKES,
    percentile,
    subsampled,
    without_hot_pixels,
)
from capture.bracket.planner import Target
from capture.bracket.raw_noise import RawNoise
from imaging.arrays import Array, Bytes
from imaging.errors import CaptureError
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.linear_frame import from_raw
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic

CLEAR = 10.0
"""Standard deviations that the dark end has in the longest probe, where the list goes that far."""
PRESENT = 5.0
"""Standard deviations at which light counts as seen."""

Shots = dict[tuple[int, int], RawMosaic]
"""The frames of one exposure, by position and take."""


class RawLook:
    """Frames of one camera so far, by exposure."""

    spacing = 4.0
    """Stops between the probes: less than what a sensor of 10 bits or more shows at once."""

    def __init__(self) -> None:
        self._probes: dict[Exposure, Shots] = {}

    def add(self, exposure: Exposure, position: int, take: int, frame: RawMosaic) -> None:
        """Keep a frame, or a sufficient sample of a large one."""
        thinned = replace(frame, pixels=subsampled(frame.pixels, lcm(*_table(frame).period)))
        self._probes.setdefault(exposure, {})[position, take] = thinned

    def clips(self, exposure: Exposure) -> bool:
        """Return whether the bright percentile of any channel is clipped."""
        return any(
            _clipped(self._probes[exposure], channel) > BRIGHT_SHARE
            for channel in _counted(self._probes[exposure])
        )

    def glare(self, exposure: Exposure) -> float:
        """The share of the frames that is clipped."""
        return float(np.mean([frame.saturated().mean() for frame in self._probes[exposure].values()]))

    def lit(self, exposure: Exposure) -> bool:
        """Return whether the dark percentile of every channel stands clear of the noise."""
        shots = self._probes[exposure]
        slope, floor = self._noise().profile(_exposure(shots))
        for channel in _counted(shots):
            takes = [_channel(shots, take, channel) for take in range(TAKES)]
            signal = percentile(takes[0], takes[1], DARK_PERCENTILE)
            if signal < CLEAR * math.sqrt(floor + slope * max(signal, 0.0)):
                return False
        return True

    def _noise(self) -> RawNoise:
        """Noise that the frames state, or that their takes show."""
        return RawNoise.of(
            [
                (shots[key], shots[key[0], 1])
                for shots in self._probes.values()
                for key in shots
                if key[1] == 0 and (key[0], 1) in shots
            ]
        )

    def targets(self, name: str) -> list[Target]:
        """The range of each channel, from the merged probes."""
        ascending = [self._probes[key] for key in sorted(self._probes, key=lambda key: key.stops)]
        shortest, longest = ascending[0], ascending[-1]
        noise = self._noise()
        positions = sorted({position for position, _ in shortest})
        frame = next(iter(shortest.values()))
        channels = np.concatenate([_sites(frame).ravel() for _ in positions])
        takes = []
        for take in range(TAKES):
            merged = [
                merge_bracket(
                    [
                        from_raw(
                            replace(shots[position, take], noise_profile=noise.profile(_exposure(shots))),
                            _exposure(shots).scale,
                        )
                        for shots in ascending
                    ]
                )
                for position in positions
            ]
            takes.append(np.concatenate([_without_hot_pixels(one, _table(frame)).ravel() for one in merged]))
        slope, floor = noise.profile(_exposure(longest))
        scale = _exposure(longest).scale
        unseen = PRESENT * (PRESENT * slope + math.sqrt(PRESENT**2 * slope**2 + 4 * floor)) / 2 / scale
        targets = []
        for channel, letter in enumerate(_table(frame).letters):
            first, other = (values[channels == channel] for values in takes)
            dark = percentile(first, other, DARK_PERCENTILE)
            bright = percentile(first, other, BRIGHT_PERCENTILE)
            # Where nothing stands out of the noise, the light is below what would have.
            visible = dark >= unseen
            targets.append(
                Target(
                    camera=name,
                    channel=letter,
                    noise=noise,
                    dark=dark if visible else unseen,
                    bright=max(bright, dark if visible else unseen),
                    no_darker=visible,
                    no_brighter=_clipped(shortest, channel) <= BRIGHT_SHARE,
                )
            )
        return targets


def _clipped(shots: Shots, channel: int) -> float:
    """The share of a channel that is clipped."""
    return float(np.concatenate([f.saturated()[_sites(f) == channel] for f in shots.values()]).mean())


def _exposure(shots: Shots) -> Exposure:
    """Return what the frames say of themselves; CaptureError if they are silent."""
    exposure = next(iter(shots.values())).metadata.exposure
    if exposure is None:
        raise CaptureError("the frames do not say how they were exposed: give the exposures yourself.")
    return exposure


def _sites(frame: RawMosaic) -> Bytes:
    return _table(frame).channels(*frame.pixels.shape)


def _table(frame: RawMosaic) -> Cfa:
    """Colour filter table; a sensor's frame, unlike a file, always is a mosaic."""
    assert frame.cfa is not None
    return frame.cfa


def _counted(shots: Shots) -> range:
    """Numbers of the channels of the frames."""
    return range(len(_table(next(iter(shots.values()))).letters))


def _channel(shots: Shots, take: int, channel: int) -> Array:
    """Signal of one channel in one take at all positions."""
    frames = [shots[key] for key in sorted(shots) if key[1] == take]
    return np.concatenate([frame.signal()[_sites(frame) == channel] for frame in frames]).astype(np.float64)


def _without_hot_pixels(merged: Merged, cfa: Cfa) -> Array:
    """A merged mosaic [H, W] without hot photosites, by the neighbours of the same site."""
    result, (down, across) = merged.radiance.astype(np.float64), cfa.period
    for row, column in np.ndindex(down, across):
        result[row::down, column::across] = without_hot_pixels(result[row::down, column::across])
    return result
