"""The meter: a few widely spaced exposures tell the range of radiance that every camera sees.

Each exposure is taken twice. Of a noisy picture the darkest 0.1 % are dark by bad luck as well as by
truth; which photosites those are is therefore read from one take and what they measure from the
other, whose noise knows nothing of that choice.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from capture.exposing import expose
from capture.planner import Target
from capture.tones import Tones
from drivers.camera import Camera
from imaging.errors import CaptureError
from imaging.exposure import Exposure
from imaging.linear import from_raw
from imaging.merge import merge_bracket
from imaging.mosaic import RawMosaic

Values = npt.NDArray[np.float64]

DARK_PERCENTILE, BRIGHT_PERCENTILE = 0.1, 99.99
SPACING = 4.0
"""Stops between the probes: less than what a sensor of 10 bits or more shows at once."""
CLEAR = 10.0
"""Standard deviations that the dark end has in the longest probe, where the list goes that far."""
PRESENT = 5.0
"""Standard deviations at which light counts as seen."""
HOT = 4.0
ENOUGH, BLOCK = 1 << 20, 4
"""Photosites of a frame that are kept, in blocks of so many by so many, spread evenly."""
TAKES = 2


@dataclass(frozen=True)
class Metering:
    """What the meter found: a target for each colour channel of each camera, and how it looked.

    probes: ascending. failed: why by camera, for those that gave no pictures and are not planned for.
    """

    targets: tuple[Target, ...]
    probes: tuple[Exposure, ...]
    failed: Mapping[str, str]


Shots = dict[tuple[int, int], RawMosaic]
"""The frames of one camera at one exposure, by position and take."""


def meter(
    cameras: Mapping[str, Camera],
    exposures: Sequence[Exposure],
    *,
    positions: Sequence[int] = (0,),
    move_to: Callable[[int], None] = lambda frame: None,
) -> Metering:
    """Probe the scene from the middle of `exposures` (ascending) outwards until both its ends are found.

    positions: of the rig, metered as one scene. All cameras expose together. A camera that fails or sees
    nothing is left out and named. Of each frame ENOUGH photosites are held until the end. CaptureError
    if no camera sees light, if all see nothing but clipped light, or if a camera develops its
    photographs itself, since those do not tell light from its tone curve.
    """
    shots: dict[str, dict[Exposure, Shots]] = {name: {} for name in cameras}
    failed: dict[str, str] = {}

    def probe(exposure: Exposure) -> None:
        for position in positions:
            move_to(position)
            for take in range(TAKES):
                ready = {name: camera for name, camera in cameras.items() if name not in failed}
                taken, errors = expose(ready, exposure)
                failed.update({name: str(error) for name, error in errors.items()})
                for name, one in taken.items():
                    if not isinstance(one.frame, RawMosaic):
                        raise CaptureError(
                            f"{name} develops its photographs itself and cannot be metered: "
                            "give the exposures yourself, as --bracket -4,-2,0,2,4."
                        )
                    shots[name].setdefault(exposure, {})[position, take] = _thinned(one.frame)
        for name in failed:
            shots.pop(name, None)

    stops = [exposure.stops for exposure in exposures]
    first = int(np.argmin(np.abs(np.array(stops) - (stops[0] + stops[-1]) / 2)))
    low = high = first
    probe(exposures[first])
    while low > 0 and any(_clips(one[exposures[low]]) for one in shots.values()):
        low = _away(stops, low, -SPACING)
        probe(exposures[low])
    while high < len(stops) - 1 and any(not _lit(one[exposures[high]]) for one in shots.values()):
        high = _away(stops, high, SPACING)
        probe(exposures[high])
    if not shots:
        raise CaptureError(f"no camera gave a picture to meter: {'; '.join(failed.values())}")
    targets = [target for name, one in shots.items() for target in _targets(name, one)]
    _must_be_seen(targets, shots, exposures[low], exposures[high])
    for name in shots:
        if not any(target.bright > target.dark for target in targets if target.camera == name):
            failed[name] = f"it sees no light at {exposures[high]}"
    targets = [target for target in targets if target.camera not in failed]
    probes = sorted({exposure for one in shots.values() for exposure in one}, key=lambda e: e.stops)
    return Metering(tuple(targets), tuple(probes), failed)


def _thinned(frame: RawMosaic) -> RawMosaic:
    """Evenly spread blocks of a large frame: they have the percentiles of the whole, in bounded memory."""
    step = math.ceil(math.sqrt(frame.pixels.size / ENOUGH))
    if step == 1:
        return frame
    rows, columns = (np.flatnonzero(np.arange(n) // BLOCK % step == 0) for n in frame.pixels.shape)
    return replace(frame, pixels=frame.pixels[np.ix_(rows, columns)])


def _away(stops: Sequence[float], index: int, by: float) -> int:
    """The index nearest to so many stops further on, and always another than `index`."""
    wanted = stops[index] + by
    beyond = range(index) if by < 0 else range(index + 1, len(stops))
    return min(beyond, key=lambda one: abs(stops[one] - wanted))


def _clips(shots: Shots) -> bool:
    """Whether the bright percentile of any channel is clipped."""
    return any(
        np.concatenate([frame.saturated()[_sites(frame) == channel] for frame in shots.values()]).mean()
        > 1 - BRIGHT_PERCENTILE / 100
        for channel in range(3)
    )


def _lit(shots: Shots) -> bool:
    """Whether the dark percentile of every channel stands clear of the noise."""
    tones = Tones.of(next(iter(shots.values())))
    exposure = _exposure(shots)
    slope, floor = tones.profile(exposure)
    for channel in range(3):
        takes = [_channel(shots, take, channel) for take in range(TAKES)]
        signal = _percentile(takes[0], takes[1], DARK_PERCENTILE)
        if signal < CLEAR * math.sqrt(floor + slope * max(signal, 0.0)):
            return False
    return True


def _exposure(shots: Shots) -> Exposure:
    """What the frames say of themselves; CaptureError if they are silent."""
    exposure = next(iter(shots.values())).metadata.exposure
    if exposure is None:
        raise CaptureError("the frames do not say how they were exposed: give the exposures yourself.")
    return exposure


def _sites(frame: RawMosaic) -> npt.NDArray[np.uint8]:
    return frame.cfa.channels(*frame.pixels.shape)


def _channel(shots: Shots, take: int, channel: int) -> Values:
    """Signal of one channel in one take at all positions."""
    frames = [shots[key] for key in sorted(shots) if key[1] == take]
    return np.concatenate([frame.signal()[_sites(frame) == channel] for frame in frames]).astype(np.float64)


def _percentile(one: Values, other: Values, percentile: float) -> float:
    """A percentile of the truth behind two noisy takes [n] of it: ranked in one, measured in the other.

    The median over all ranks beyond the percentile, which errs outwards as far as misjudged ranks err
    inwards; twice, with the takes exchanged, and averaged.
    """
    ranks = slice(0, math.ceil(min(percentile, 100.0 - percentile) / 100.0 * (len(one) - 1)) + 1)
    sign = 1.0 if percentile < 50.0 else -1.0
    pairs = ((one, other), (other, one))
    return float(np.mean([np.median(b[np.argsort(sign * a, kind="stable")[ranks]]) for a, b in pairs]))


def _cooled(image: npt.NDArray[np.floating]) -> Values:
    """A mosaic [H, W] without hot photosites: those HOT times above their eight neighbours of the same site.

    They become as bright as the brightest of these. A lens spreads a true highlight further.
    """
    cooled = image.astype(np.float64)
    around = np.ones((3, 3), bool)
    around[1, 1] = False
    for plane in (cooled[row::2, column::2] for row in (0, 1) for column in (0, 1)):
        others = np.maximum(ndimage.maximum_filter(plane, footprint=around, mode="mirror"), 0.0)
        np.copyto(plane, others, where=plane > HOT * others)
    return cooled


def _targets(name: str, probes: Mapping[Exposure, Shots]) -> list[Target]:
    """The range of each channel of one camera, from the merged probes."""
    ascending = [probes[exposure] for exposure in sorted(probes, key=lambda exposure: exposure.stops)]
    shortest, longest = ascending[0], ascending[-1]
    tones = Tones.of(next(iter(shortest.values())))
    positions = sorted({position for position, _ in shortest})
    frame = next(iter(shortest.values()))
    channels = np.concatenate([_sites(frame).ravel() for _ in positions])
    takes = []
    for take in range(TAKES):
        merged = [
            merge_bracket([from_raw(shots[position, take], _exposure(shots).scale) for shots in ascending])
            for position in positions
        ]
        takes.append(np.concatenate([_cooled(one.radiance).ravel() for one in merged]))
    slope, floor = tones.profile(_exposure(longest))
    scale = _exposure(longest).scale
    unseen = PRESENT * (PRESENT * slope + math.sqrt(PRESENT**2 * slope**2 + 4 * floor)) / 2 / scale
    targets = []
    for channel, letter in enumerate("RGB"):
        one, other = (values[channels == channel] for values in takes)
        dark = _percentile(one, other, DARK_PERCENTILE)
        bright = _percentile(one, other, BRIGHT_PERCENTILE)
        clipped = np.concatenate([f.saturated()[_sites(f) == channel] for f in shortest.values()]).mean()
        # Where nothing stands out of the noise, the light is below what would have.
        seen = dark >= unseen
        targets.append(
            Target(
                camera=name,
                channel=letter,
                tones=tones,
                dark=dark if seen else unseen,
                bright=max(bright, dark if seen else unseen),
                no_darker=seen,
                no_brighter=bool(clipped <= 1 - BRIGHT_PERCENTILE / 100),
            )
        )
    return targets


def _must_be_seen(
    targets: Sequence[Target],
    shots: Mapping[str, Mapping[Exposure, Shots]],
    shortest: Exposure,
    longest: Exposure,
) -> None:
    """CaptureError where the exposures that there are show nothing at all of the scene."""
    if all(not target.no_darker and target.bright <= target.dark for target in targets):
        raise CaptureError(
            f"the scene is black: no camera sees light at {longest}; "
            "take off the lens caps, light the scene or allow longer exposures."
        )
    if all(
        np.mean([frame.saturated().mean() for frame in one[shortest].values()]) > 0.999
        for one in shots.values()
    ):
        raise CaptureError(
            f"the scene is too bright: every camera clips all over at {shortest}; "
            "stop the lenses down, use a filter or allow shorter exposures."
        )
