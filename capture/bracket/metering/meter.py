"""The meter: a few widely spaced exposures measure the range of radiance that every camera sees.

Each exposure is taken twice. Of a noisy picture the darkest 0.1 % are dark by bad luck as well as by truth;
which photosites those are is therefore read from one take and what they measure from the other, whose noise
is independent of that choice.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from capture.bracket.metering.code_metering import CodeLook
from capture.bracket.metering.percentile import TAKES
from capture.bracket.metering.raw_metering import RawLook
from capture.bracket.planner import Target
from capture.bracket.single_exposure import expose
from drivers.camera import Camera, CameraFile
from imaging.errors import CaptureError, InputError
from imaging.files.photo import Photo, decode_photo
from imaging.files.raw import SUFFIXES as RAW_SUFFIXES
from imaging.files.raw import decode_raw
from imaging.optics.exposure import Exposure
from imaging.progress import Progress, unreported
from imaging.sensor.mosaic import RawMosaic


@dataclass(frozen=True)
class Metering:
    """Result of the metering: a target for each colour channel of each camera, and its probes.

    probes: ascending. failed: why by camera, for those that gave no pictures and are not planned for.
    """

    targets: tuple[Target, ...]
    probes: tuple[Exposure, ...]
    failed: Mapping[str, str]


def meter(
    cameras: Mapping[str, Camera],
    exposures: Sequence[Exposure],
    *,
    positions: Sequence[int] = (0,),
    move_to: Callable[[int], None] = lambda frame: None,
    progress: Progress = unreported,
) -> Metering:
    """Probe the scene from the middle of `exposures` outwards until both its ends are found.

    All cameras expose together. A camera that fails or sees nothing is left out and named. Memory is bounded,
    however large the frames.

    Args:
        cameras: Cameras by name.
        exposures: Exposures to probe with, ascending.
        positions: Frames to go to, metered as one scene.
        move_to: Callback that brings rig or scene to a frame, before each exposure there.
        progress: Callback for each probe; how many there will be is not known.

    Returns:
        A target for each colour channel of each camera, the probes, and the cameras that were left out.

    Raises:
        CaptureError: No camera gives a picture or sees light, or all see nothing but clipped light.
    """
    probing = _Probing(cameras, positions, move_to, progress)
    shortest, longest = _to_both_ends(probing, exposures)
    targets, dark = _targets_of(probing.looks, cameras, shortest, longest)
    failed = probing.failed | dict.fromkeys(dark, f"it sees no light at {longest}")
    probes = sorted(probing.probes, key=lambda exposure: exposure.stops)
    return Metering(tuple(targets), tuple(probes), failed)


@dataclass
class _Probing:
    """Pictures of the scene at single exposures, and what each camera shows in all of them.

    looks: by camera. failed: why by camera, for those that gave no pictures. probes: in order.
    """

    cameras: Mapping[str, Camera]
    positions: Sequence[int]
    move_to: Callable[[int], None]
    progress: Progress
    looks: dict[str, RawLook | CodeLook] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    probes: list[Exposure] = field(default_factory=list)

    def probe(self, exposure: Exposure) -> None:
        """Add the takes of one exposure, at all positions; cameras that fail are left out from then on.

        CaptureError if none remains.
        """
        self.probes.append(exposure)
        self.progress(f"metering, probe {len(self.probes)}: {exposure}", 0, 0)
        for position in self.positions:
            self.move_to(position)
            for take in range(TAKES):
                ready = {name: camera for name, camera in self.cameras.items() if name not in self.failed}
                taken, errors = expose(ready, exposure)
                self.failed.update({name: str(error) for name, error in errors.items()})
                for name, captured in taken.items():
                    self._look(name, captured.frame, exposure, position, take)
        for name in self.failed:
            self.looks.pop(name, None)
        if not self.looks:
            raise CaptureError(f"no camera gave a picture to meter: {'; '.join(self.failed.values())}")

    def _look(
        self, name: str, taken: RawMosaic | CameraFile, exposure: Exposure, position: int, take: int
    ) -> None:
        """Add one picture to what its camera shows; a camera whose pictures are of no use has failed."""
        try:
            frame = _decoded(taken, name)
        except InputError as error:
            self.failed[name] = f"it delivered a damaged file: {error}"
            return
        look = self.looks.setdefault(name, RawLook() if isinstance(frame, RawMosaic) else CodeLook())
        if isinstance(look, RawLook) and isinstance(frame, RawMosaic):
            look.add(exposure, position, take, frame)
        elif isinstance(look, CodeLook) and isinstance(frame, Photo):
            look.add(exposure, position, take, frame.pixels)
        else:
            self.failed[name] = "it delivers RAW files and photographs in turn"


def _to_both_ends(probing: _Probing, exposures: Sequence[Exposure]) -> tuple[Exposure, Exposure]:
    """Probe outwards from the middle, in steps as wide as the range of one frame.

    Returns:
        The shortest and the longest exposure that was probed.
    """
    stops = [exposure.stops for exposure in exposures]
    first = int(np.argmin(np.abs(np.array(stops) - (stops[0] + stops[-1]) / 2)))
    low = high = first
    looks = probing.looks
    probing.probe(exposures[first])
    spacing = min(look.spacing for look in looks.values())
    # Downwards until no camera clips: only then is its brightest light measured.
    while low > 0 and any(look.clips(exposures[low]) for look in looks.values()):
        low = _away(stops, low, -spacing)
        probing.probe(exposures[low])
    # Upwards until the darkest light of every camera stands clear of the noise.
    while high < len(stops) - 1 and any(not look.lit(exposures[high]) for look in looks.values()):
        high = _away(stops, high, spacing)
        probing.probe(exposures[high])
    return exposures[low], exposures[high]


def _targets_of(
    looks: Mapping[str, RawLook | CodeLook], order: Iterable[str], shortest: Exposure, longest: Exposure
) -> tuple[list[Target], list[str]]:
    """The targets of the cameras that see light, in the rig's order, and the names of those that see none.

    A camera that saw nothing is left out; the others can still be planned for.
    """
    metered = [name for name in order if name in looks]  # `looks` is in the order of the answers
    targets = [target for name in metered for target in looks[name].targets(name)]
    _must_be_seen(targets, looks, shortest, longest)
    lit = {target.camera for target in targets if target.bright > target.dark}
    return [target for target in targets if target.camera in lit], [name for name in looks if name not in lit]


def _decoded(frame: RawMosaic | CameraFile, name: str) -> RawMosaic | Photo:
    if isinstance(frame, RawMosaic):
        return frame
    if frame.suffix in RAW_SUFFIXES:
        return decode_raw(frame.data, frame.suffix)
    return decode_photo(frame.data, f"a photograph of {name}")


def _away(stops: Sequence[float], index: int, by: float) -> int:
    """Index of the exposure nearest to that many stops further on, always other than `index`."""
    wanted = stops[index] + by
    beyond = range(index) if by < 0 else range(index + 1, len(stops))
    return min(beyond, key=lambda candidate: abs(stops[candidate] - wanted))


def _must_be_seen(
    targets: Sequence[Target],
    looks: Mapping[str, RawLook | CodeLook],
    shortest: Exposure,
    longest: Exposure,
) -> None:
    """Raise CaptureError if the available exposures show nothing at all of the scene."""
    if all(not target.no_darker and target.bright <= target.dark for target in targets):
        raise CaptureError(
            f"the scene is black: no camera sees light at {longest}; "
            "take off the lens caps, light the scene or allow longer exposures."
        )
    if all(look.glare(shortest) > 0.999 for look in looks.values()):
        raise CaptureError(
            f"the scene is too bright: every camera clips all over at {shortest}; "
            "stop the lenses down, use a filter or allow shorter exposures."
        )
