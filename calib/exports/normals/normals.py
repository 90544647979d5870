"""`rig normals`: normals and albedo of what stands in a light dome, from brackets under each of its lamps.

Each photosite of a mosaic is fitted by itself, with the noise that its sensor has; only the albedo is
demosaicked afterwards. Parts of the file: light (albedo as R, G, B), normal (normal.X, normal.Y, normal.Z),
sigma (of R, G, B and of the normal, degrees), mask.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import IO

import numpy as np

from calib.data.views import scene_views
from calib.exports.merge_session import current_calibration, of_one_band
from calib.exports.normals.fit import FEWEST, PixelFit, fit
from calib.exports.normals.lamps import check_lamps, differences, incoming, on_plane
from calib.exports.normals.normal_file import Mosaic, Patch, write_normals
from imaging.arguments import checked
from imaging.arrays import Array, Array32, Mask
from imaging.compute import memory
from imaging.errors import InputError
from imaging.files import store
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.linear_frame import read_linear
from imaging.plates.bracket_exposures import exposure_scales, response_of
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord
from imaging.session.lamps import LampsRecord
from imaging.session.records import ShotRecord
from imaging.session.session import LAMPS, Session

_SAMPLES = 400
"""Pixels of each strip of rows that lamps are compared at."""
_STRIP = 1 << 18
"""Pixels fitted at a time, at most."""
_BYTES = 200
"""Memory for each pixel."""


@dataclass(frozen=True)
class Normals:
    """Result of `estimate_normals`.

    Attributes:
        file: EXR file.
        preview: PNG of normals and albedo.
        lamps: Number of lamps.
        known: Share of the pixels with a normal, 0..1.
        matt: Share of the pixels lit by three lamps or more that fit as a matt surface, 0..1.
        error: Median standard error of a normal, degrees.
        misfit: Relative difference of the lamps' light from what the fit expects.
        absolute: Whether albedo is by a patch of known reflectance; else it is relative.
        warnings: Lamps that differ from what is stated of them.
    """

    file: Path
    preview: Path
    lamps: int
    known: float
    matt: float
    error: float
    misfit: float
    absolute: bool
    warnings: tuple[str, ...]


@checked
def estimate_normals(
    session: str | PathLike[str],
    out: str | PathLike[str],
    *,
    white: tuple[int, int, int, int] | None = None,
    reflectance: float = 1.0,
    on_progress: Progress = unreported,
) -> Normals:
    """Estimate normals and albedo from brackets under known lamps, `lamps.json` of the session.

    Args:
        session: Session, or its folder; its calibration counts if there is one.
        out: EXR file; a PNG of the same name is written beside it.
        white: Area of a neutral patch, px; None: albedo is relative, with a median of 0.18.
        reflectance: Of that patch, 0..1.
        on_progress: Callback for the current step, the steps done, and all of them.

    Returns:
        What was written, and how well the lamps explain the light.

    Raises:
        InputError: The pictures are linear EXR; lamps are missing, in one plane or not those of the shots; a
            file is damaged; nothing is measured in the patch.
        StorageError: The disk refuses.
    """
    session, out = Path(session), Path(out)
    patch = None if white is None else Patch(white, reflectance)
    if out.suffix.lower() != ".exr":
        raise InputError(f"{out} is no EXR file: name the normals such as normals.exr.")
    opened, calibration = Session.open(session), current_calibration(session)
    dome = _dome(opened)
    store.require_writable(out.parent)
    # A new folder is made with the file in it only, so that a failure leaves none.
    with store.scratch(next(folder for folder in out.parents if folder.exists())) as file:
        clipped, mosaic = _stacked(file, opened, dome, calibration, out, on_progress)
        stack = np.memmap(file, np.float32, "r", shape=(len(dome.lit), 2, *mosaic.shape))
        fitted, ratios = _fitted(dome.record, dome.lit, stack, calibration, dome.camera, on_progress)
    lighted = fitted.lamps >= FEWEST
    matt = float(fitted.known[lighted].mean()) if lighted.any() else 1.0  # the file is refused without any
    misfit, warnings = differences(ratios, matt, dome.record, dome.lit, session / LAMPS)
    written = write_normals(
        out,
        fitted,
        mosaic,
        clipped,
        None if calibration is None else calibration.camera(dome.camera),
        patch,
        {
            "rig:lamps": json.dumps({frame: dome.record.places[frame] for frame in dome.lit}),
            "rig:misfit": misfit,
        },
    )
    return Normals(
        file=out,
        preview=written.preview,
        lamps=len(dome.lit),
        known=written.known,
        matt=matt,
        error=written.error,
        misfit=misfit,
        absolute=patch is not None,
        warnings=warnings,
    )


@dataclass(frozen=True)
class _Dome:
    """Brackets under known lamps. camera: that the axes of the lamps are of. shots: by frame. lit: frames
    with a lamp; the others show the light of the room.
    """

    record: LampsRecord
    camera: str
    shots: Mapping[int, Sequence[ShotRecord]]
    lit: list[int]


def _dome(session: Session) -> _Dome:
    """The lamps of a session and their brackets; InputError where no normals follow from them."""
    record = session.lamps()
    if record is None:
        raise InputError(
            f"{session.folder} has no {LAMPS}: write one that states where the lamp of each frame stands."
        )
    camera = _camera(session, record)
    if session.camera(camera).kind == "hdr":
        raise InputError(
            f"{session.folder} holds linear EXR or HDR pictures, whose noise is not known: import the RAW "
            "files or photographs of the dome."
        )
    shots = {view.frame: view.shots for view in scene_views(session) if view.camera.name == camera}
    check_lamps(record, sorted(shots), session.folder / LAMPS)
    if any(len(of_one_band(group)) > 1 for group in shots.values()):
        raise InputError(
            f"{session.folder} was shot through filters, of which each has its own light: shoot one."
        )
    return _Dome(
        record, camera, shots, [frame for frame in sorted(shots) if record.places[frame] is not None]
    )


def _camera(session: Session, record: LampsRecord) -> str:
    """Name of the camera that the axes of the lamps are of."""
    names = [camera.name for camera in session.record.cameras]
    if record.camera is None and len(names) > 1:
        raise InputError(
            f"{session.folder} has the cameras {', '.join(names)}: name as camera in {LAMPS} the one whose "
            "axes the lamps are in."
        )
    return session.camera(record.camera or names[0]).name


def _merged(
    session: Session, camera: str, shots: Sequence[ShotRecord], calibration: CalibrationRecord | None
) -> Merged:
    """A bracket as its mosaic records it."""
    scales = None if calibration is None else calibration.exposure_scale
    sensors = () if calibration is None else calibration.camera(camera).sensors
    response, kind = response_of(session, camera, calibration), session.camera(camera).kind
    return merge_bracket(
        [
            read_linear(session.file(shot), kind, scale, response, sensors)
            for shot, scale in zip(shots, exposure_scales(session, shots, scales), strict=True)
        ]
    )


def _stacked(
    file: IO[bytes],
    session: Session,
    dome: _Dome,
    calibration: CalibrationRecord | None,
    out: Path,
    progress: Progress,
) -> tuple[Mask, Mosaic]:
    """Write the light of each lamp and its standard deviation to a file; out: for which that is.

    Returns:
        Photosites that any bracket clips, and the shape and filters of all.
    """
    rooms = [
        _merged(session, dome.camera, dome.shots[frame], calibration)
        for frame in sorted(set(dome.shots) - set(dome.lit))
    ]
    for done, frame in enumerate(dome.lit):
        progress("merging", done, len(dome.lit))
        merged = _merged(session, dome.camera, dome.shots[frame], calibration)
        height, width = merged.radiance.shape[:2]
        if done == 0:
            memory.check(f"normals of {width}x{height} pixels", _BYTES * width * height)
            clipped, mosaic = merged.clipped, Mosaic(merged.radiance.shape, merged.cfa)
        if merged.sigma is None:
            raise InputError(
                f"{session.folder}: the noise of camera {dome.camera} is not known: run "
                "`rig calibrate --only sensor`."
            )
        clipped = clipped | merged.clipped
        _append(file, merged, rooms, out)
    return clipped, mosaic


def _append(file: IO[bytes], merged: Merged, rooms: Sequence[Merged], out: Path) -> None:
    """Append the light of a lamp without that of the room, and its standard deviation."""
    light, sigma = merged.radiance, merged.sigma
    assert sigma is not None
    if rooms:
        deviations = [np.full_like(one.radiance, np.inf) if one.sigma is None else one.sigma for one in rooms]
        light = light - np.mean([one.radiance for one in rooms], axis=0)
        sigma = np.sqrt(sigma**2 + np.mean(np.square(deviations), axis=0) / len(rooms))
    try:
        file.write(np.asarray(light, np.float32).tobytes())
        file.write(np.asarray(sigma, np.float32).tobytes())
        file.flush()
    except OSError as error:
        raise store.refused(out, error) from error


def _fitted(
    record: LampsRecord,
    frames: Sequence[int],
    stack: Array32,
    calibration: CalibrationRecord | None,
    camera: str,
    progress: Progress,
) -> tuple[PixelFit, Array]:
    """Fit of all pixels, and the light of each lamp over what the fit expects, at some of them [L, S]."""
    height, width = stack.shape[2:4]
    lens = None if calibration is None else calibration.camera(camera).lens
    places = on_plane(record, lens, width, height)
    rows = max(1, _STRIP // width)
    parts, ratios = list[PixelFit](), list[Array]()
    for top in range(0, height, rows):
        progress("fitting normals", top, height)
        strip = stack[:, :, top : top + rows]
        pixels = strip.shape[2] * width
        light = np.array(strip[:, 0]).reshape(len(frames), pixels, -1)
        sigma = np.array(strip[:, 1]).reshape(len(frames), pixels, -1)
        lamps = incoming(
            record, frames, None if places is None else places[top : top + rows].reshape(-1, 3), pixels
        )
        part = fit(light, sigma, lamps, record.spread)
        parts.append(part)
        sample = np.flatnonzero(part.known)
        sample = sample[:: max(1, len(sample) // _SAMPLES)]
        along = np.einsum("lpi,pi->lp", lamps[:, sample], part.normal[sample])
        strength = np.linalg.norm(lamps[:, sample], axis=-1)
        expected = along * part.albedo[sample].sum(axis=-1)
        shown = np.isfinite(sigma[:, sample]).all(axis=-1) & (along > 0.3 * strength)
        ratios.append(
            np.divide(
                light[:, sample].sum(axis=-1), expected, out=np.full_like(expected, np.nan), where=shown
            )
        )
    progress("fitting normals", height, height)
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
    return PixelFit(**joined), np.concatenate(ratios, axis=1)
