"""`rig merge --panorama`: brackets of views from one place as one EXR of all directions.

The views' turns and lenses are those of the calibration, and so is the light: in cd/m2 where its scale is
known. Parts of the file: light (R, G, B, and A where a part of all directions is in no view), sigma, mask.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from os import PathLike
from pathlib import Path

import numpy as np

from calib.exports.merge_session import current_calibration
from calib.exports.panorama.gathering import Map
from calib.exports.panorama.laying import laid_views, require_measured
from calib.exports.panorama.layout import header, solid_angles
from calib.exports.panorama.seams import Seam, seams
from calib.exports.panorama.standpoint import map_axes, parallax_of, upright_motion
from calib.exports.panorama.sun import RECOVERED, ClippedRegion, clipped_regions, share_unseen, with_sun
from calib.exports.request import PanoramaRequest
from imaging.arguments import checked
from imaging.arrays import Array
from imaging.choices import SPACE_NAMES, SPACE_PRIMARIES, ExrStorage
from imaging.colour.spaces import XYZ_FROM_REC709, space_from_rec709
from imaging.compute import memory
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr.writing import EXPOSURE_FACTOR, LATLONG, ExrValue, white_luminance, write_exr
from imaging.merge.picture import BITS, NOTHING
from imaging.optics.pose import on_their_side
from imaging.plates.merged_view import CAMERA_RGB, UNIT
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord, ViewCalibration
from imaging.session.luminance import LuminanceScale
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets

MOST_PARALLAX = 2.0
"""Degrees by which what lies at a usual distance may stand elsewhere in another view."""
WIDEST = 4096
"""Columns of a map whose width is not given, at most."""
_BYTES = 80
"""Memory for each of its texels."""
_DEFAULTS = PanoramaRequest()


@dataclass(frozen=True)
class Panorama:
    """Result of `merge_panorama`.

    Attributes:
        file: EXR file.
        width: Columns; half as many rows.
        views: Number of views.
        exposure_factor: Factor of the values on the light of the calibration.
        absolute: Whether the values are cd/m2.
        known: Share of all directions that a view shows, 0..1.
        seams: Views that overlap, and their differences.
        clipped: Regions that every exposure clips, the brightest first.
        parallax: Degrees by which things at a usual distance stand elsewhere in another view; None: unknown.
        unseen: Share of the light on a card facing the sun that no view shows, were it alike; 0 without.
        camera_rgb: Cameras whose colour is not known; with any, the file is camera RGB.
        warnings: Of the merged brackets, on which way is up, and on positions that differ.
    """

    file: Path
    width: int
    views: int
    exposure_factor: float
    absolute: bool
    known: float
    seams: tuple[Seam, ...]
    clipped: tuple[ClippedRegion, ...]
    parallax: float | None
    unseen: float
    camera_rgb: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def seam_stops(self) -> float | None:
        """Median over pairs of views of how far they differ, stops; None if none overlap."""
        return float(np.median([abs(seam.stops) for seam in self.seams])) if self.seams else None

    @property
    def worst_seam(self) -> Seam | None:
        """The two views that differ most."""
        return max(self.seams, key=lambda seam: abs(seam.stops), default=None)


@checked
def merge_panorama(
    session: str | PathLike[str],
    out: str | PathLike[str],
    request: PanoramaRequest = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    **options: object,
) -> Panorama:
    """Merge brackets of views from one place into one map of all directions.

    Args:
        session: Calibrated session, or its folder.
        out: EXR file.
        request: Options; without an exposure, values are cd/m2 where the scale is known, else the light.
        on_progress: Callback for the current step, the steps done, and all of them.
        options: Options by name, in place of those of `request`.

    Returns:
        What was written, and how well views agree.

    Raises:
        InputError: There are no poses, the views stand apart, an option cannot be used, a file is damaged,
            nothing is measured, light is too bright for the storage.
        StorageError: The disk refuses.
    """
    session, out, space = Path(session), Path(out), request.space
    if out.suffix.lower() != ".exr":
        raise InputError(f"{out} is no EXR file: name the panorama such as sky.exr.")
    opened, calibration = Session.open(session), current_calibration(session)
    if calibration is None or not calibration.views:
        raise InputError(
            f"{session} has no view with a pose: run `rig calibrate` first, then merge it again."
        )
    chosen = _chosen(opened, calibration, request.frame, request.camera)
    _require_one_band(session, chosen)
    views = [view for view, _ in chosen]
    scale = _scale_of(calibration, views)
    if request.sun is not None and (scale is None or request.exposure is not None):
        raise InputError(
            "--sun is an illuminance, and needs the light in cd/m2: leave --exposure out, and run "
            "`rig calibrate --luminance` with a reading of a spot meter first."
        )
    apart, parallax = parallax_of(session, views)
    _require_one_place(session, parallax)
    store.require_writable(out.parent)
    factor = 1.0
    if request.exposure is not None:
        factor = 2.0**request.exposure
    elif scale is not None:
        factor = scale.value
    rows = _rows(calibration, views, request.width)
    upright = [upright_motion(opened, view, shots) for view, shots in chosen]
    axes = map_axes(upright)
    warnings = list(_doubts(None if parallax is not None else apart, upright))

    # Every view is laid into the map, which keeps light, deviation and mask of each direction.
    laid = laid_views(opened, calibration, chosen, axes, rows, space, on_progress)
    warnings += laid.warnings
    gathered = _brighter(laid.gathering.result(), factor)
    require_measured(session, gathered, laid.measured, rows)

    # What every exposure clips has the light that is missing on a card, if that was measured.
    luminance = XYZ_FROM_REC709[1] @ np.linalg.inv(space_from_rec709(space))
    clipped, brightest = clipped_regions(gathered, luminance)
    unseen = 0.0
    if request.sun is not None:
        if not clipped:
            raise InputError(
                f"--sun {request.sun:g}: nothing is clipped in the shortest exposures of {session}, so that "
                "all light is measured: leave --sun out."
            )
        unseen = share_unseen(gathered, clipped[0])
        gathered, clipped[0] = with_sun(gathered, (clipped[0], brightest), request.sun, luminance)

    known = float(((gathered.mask != NOTHING) * solid_angles(rows)).sum() / (4 * np.pi))
    panorama = Panorama(
        out, 2 * rows, len(chosen), factor, scale is not None and request.exposure is None, known,
        seams([view.id for view in views], laid.gathering.compared, luminance), tuple(clipped), parallax,
        unseen, tuple(laid.uncoloured), tuple(warnings),
    )  # fmt: skip
    attributes = _attributes(panorama, CAMERA_RGB if laid.uncoloured else SPACE_NAMES[space])
    attributes |= header(axes)
    if scale is not None and not laid.uncoloured:
        attributes |= white_luminance(scale.value / factor, scale.error / factor)
    _write(out, gathered, attributes, None if laid.uncoloured else SPACE_PRIMARIES[space], request.exr)
    return panorama


def _scale_of(calibration: CalibrationRecord, views: Sequence[ViewCalibration]) -> LuminanceScale | None:
    """The scale of the light in cd/m2; None unless it is that of every camera."""
    scale = calibration.luminance
    return scale if scale is not None and all(view.camera in scale.cameras for view in views) else None


def _require_one_place(session: Path, parallax: float | None) -> None:
    """InputError for views that stand apart."""
    if parallax is not None and parallax > MOST_PARALLAX:
        raise InputError(
            f"{session}: the views stand apart, so that things are up to {parallax:.1f} degrees elsewhere in "
            "one than in another: turn the camera about its entrance pupil, name one --frame of a rig, or "
            "draw a probe of a reconstructed scene with `rig render --probe`."
        )


def _doubts(apart: float | None, upright: Sequence[Array]) -> Iterator[str]:
    """A sentence for each reason to doubt the poses; apart: distance of the views, of unknown effect."""
    if apart is not None:
        yield (
            f"The positions of the views differ by at most {apart:.2g} units of the calibration, and no "
            "scene points say how far away things are: near things may stand elsewhere in one view than in "
            "another."
        )
    if on_their_side(upright):
        yield (
            "The pictures stand on their side, and their files do not state which side is up, so that up and "
            "down of the panorama may be exchanged."
        )


def _brighter(gathered: Map, factor: float) -> Map:
    """The map with its light times a factor."""
    times = np.float32(factor)
    sigma = None if gathered.sigma is None else gathered.sigma * times
    return Map(gathered.light * times, sigma, gathered.mask)


def _attributes(panorama: Panorama, colour: str) -> dict[str, ExrValue]:
    """Header of the file, without its axes."""
    attributes: dict[str, ExrValue] = {
        "rig:units": "cd/m2" if panorama.absolute else UNIT,
        EXPOSURE_FACTOR: panorama.exposure_factor,
        "rig:mask": f"{BITS}; {RECOVERED} recovered: by a meter, spread evenly",
        "rig:known": panorama.known,
        "rig:seams": json.dumps([str(seam) for seam in panorama.seams]),
        "rig:colour": colour,
        "software": f"rig {version('hdr-rig')}",
        **LATLONG,
    }
    if panorama.seam_stops is not None:
        attributes["rig:seamStops"] = panorama.seam_stops
    return attributes


def _write(
    out: Path, gathered: Map, attributes: dict[str, ExrValue], primaries: str | None, storage: ExrStorage
) -> None:
    channels = {letter: gathered.light[..., index] for index, letter in enumerate("RGB")}
    shown = gathered.mask != NOTHING
    if not shown.all():
        channels["A"] = shown.astype(np.float32)
    data = {"mask": {"mask": gathered.mask.astype(np.float32)}}
    if gathered.sigma is not None:
        sigma = {f"sigma.{letter}": gathered.sigma[..., index] for index, letter in enumerate("RGB")}
        data = {"sigma": sigma, **data}
    write_exr(out, channels, storage=storage, primaries=primaries, attributes=attributes, data=data)


def _chosen(
    session: Session, calibration: CalibrationRecord, frame: int | None, camera: str | None
) -> list[tuple[ViewCalibration, list[ShotRecord]]]:
    """The views with poses that are wanted, and their shots."""
    shots = brackets(session.shots("scene"))
    chosen = [
        (view, list(shots[view.id]))
        for view in calibration.views
        if view.id in shots and frame in (None, view.frame) and camera in (None, view.camera)
    ]
    if not chosen:
        raise InputError(
            f"{session.folder} has no view with a pose of that frame or camera: name one that `rig check` "
            "lists."
        )
    return chosen


def _require_one_band(session: Path, chosen: Sequence[tuple[ViewCalibration, list[ShotRecord]]]) -> None:
    """InputError where views were shot through several filters, or some of them through none."""
    bands: dict[str, set[str | None]] = {}
    for view, shots in chosen:
        bands.setdefault(view.camera, set()).update(shot.band for shot in shots)
    if len(set.union(*bands.values())) == 1:
        return
    apart = all(len(of_camera) == 1 for of_camera in bands.values())
    fix = f"name one --camera ({', '.join(bands)}), or merge" if apart else "merge"
    raise InputError(f"{session} was shot through filters: {fix} its bands without --panorama.")


def _rows(calibration: CalibrationRecord, views: Sequence[ViewCalibration], width: int | None) -> int:
    """Rows of the map. InputError for a width that is no map's, or that the memory does not hold."""
    if width is not None and (width < 4 or width % 2 or width > 1 << 15):
        raise InputError(f"--width {width}: a panorama is an even number of columns, 4 to 32768.")
    if width is None:
        lenses = [calibration.camera(view.camera).lens for view in views]
        focal = max(lens.fx for lens in lenses if lens is not None)
        width = min(2 * round(np.pi * focal), WIDEST)
    memory.check(f"a panorama of {width} columns", _BYTES * width * width // 2)
    return width // 2
