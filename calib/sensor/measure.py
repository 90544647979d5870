"""The sensors of a session: from its darks and flats where it has them, else from the brackets."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from calib.data.views import View, of_one_band
from calib.sensor import brackets
from calib.sensor.brackets import Blind
from calib.sensor.emva1288 import emva
from calib.sensor.emva1288.emva import Frames, Nominal
from calib.sensor.emva1288.flats import FlatFalloff
from calib.sensor.linearity import straightness
from calib.sensor.stack import Stack, gather, sites
from imaging.errors import InputError
from imaging.files.raw import read_raw
from imaging.merge.masks import mask_of
from imaging.optics.dial_settings import meant
from imaging.optics.exposure import Exposure
from imaging.progress import Progress
from imaging.sensor.sensor_calibration import Measured, SensorCalibration
from imaging.session.records import CameraRecord, ShotRecord
from imaging.session.session import Session

VIEWS = 6
"""Views of a camera that its sensor is measured from where there are no darks and flats."""

COARSE = 8
"""Darks of each time that are kept at hand where the sensor counts coarsely."""


@dataclass(frozen=True)
class MeasuredSensor:
    """Measurements of one camera.

    at: of every ISO that its shots have; nominal: what the files say, ISO by ISO; falloff: by flats of the
    f-number of the scene, where there are any; missing: what lacks, in words.
    """

    at: tuple[SensorCalibration, ...] = ()
    nominal: tuple[Nominal, ...] = ()
    falloff: FlatFalloff | None = None
    missing: tuple[str, ...] = ()


def measure_sensors(session: Session, views: Sequence[View], progress: Progress) -> dict[str, MeasuredSensor]:
    """Every RAW camera of the session; InputError for a missing or damaged file."""
    cameras = [camera for camera in session.record.cameras if camera.kind == "raw"]
    views = of_one_band(views)
    measured = {}
    for done, camera in enumerate(cameras):
        progress("measuring the sensors", done, len(cameras))
        measured[camera.name] = _camera(session, camera, [v for v in views if v.camera.name == camera.name])
    return measured


def _camera(session: Session, camera: CameraRecord, views: Sequence[View]) -> MeasuredSensor:
    darks, flats = (
        [shot for shot in session.shots(kind) if shot.camera == camera.name] for kind in ("dark", "flat")
    )
    scene = [shot for view in views for shot in view.shots]
    at, nominals, missing = [], [], []
    fall = None
    isos = list(dict.fromkeys(_iso(shot) for shot in [*scene, *darks, *flats]))
    for iso in isos:
        of_iso = [[shot for shot in shots if _iso(shot) == iso] for shots in (darks, flats)]
        nominal = _nominal(session, [*of_iso[0], *of_iso[1], *scene], iso)
        if nominal is None:
            missing.append(f"{camera.name} gives demosaicked light, which does not show its sensor")
            break
        measured = SensorCalibration(iso=iso)
        blind = None
        if not (of_iso[0] and of_iso[1]):
            blind = _blind(session, views, iso, nominal)
        if of_iso[0] or of_iso[1]:
            gain = _measured(brackets.gain(blind.transfer)) if blind and blind.transfer else None
            frames = _frames(session, of_iso[0], of_iso[1], nominal)
            measured, falloff = emva.measure_emva(frames, nominal, iso, gain)
            if falloff is not None and fall is None:
                of_flats = _stops(of_iso[1])
                if len(of_flats) == 1 and _stops(scene) <= of_flats:
                    fall = falloff
                else:
                    missing.append(f"{camera.name} has flats at other f-numbers than the scene")
        if blind is not None:
            measured = _filled(measured, blind, nominal)
        at.append(measured)
        nominals.append(nominal)
        missing += _lacking(camera.name, iso, measured, of_iso, blind, bool(darks or flats))
    return MeasuredSensor(
        at=tuple(at),
        nominal=tuple(nominals),
        falloff=fall,
        missing=tuple(missing),
    )


def _iso(shot: ShotRecord) -> float | None:
    return None if shot.exposure is None else shot.exposure.iso


def _stops(shots: Iterable[ShotRecord]) -> set[float | None]:
    return {shot.exposure.f_number for shot in shots if shot.exposure is not None}


def _nominal(session: Session, shots: Iterable[ShotRecord], iso: float | None) -> Nominal | None:
    """Return what the first file of an ISO says; None if it is no mosaic."""
    first = next(shot for shot in shots if _iso(shot) == iso)
    raw = read_raw(session.file(first))
    if raw.cfa is None:
        return None
    black = sites(raw.black_map(), raw.cfa.tile).mean(axis=(1, 2), dtype=np.float64)
    return Nominal(np.asarray(black), float(raw.white), raw.cfa.tile)


def _frames(session: Session, darks: list[ShotRecord], flats: list[ShotRecord], nominal: Nominal) -> Frames:
    """Stacks of equal exposures, read one frame at a time."""
    stacks: list[list[Stack]] = []
    groups = [_groups(darks), _groups(flats)]
    meanings = meant(key for group in groups for key in group)
    for group, black in zip(groups, (None, float(nominal.black.mean())), strict=True):
        stack = []
        for key, shots in group.items():
            exact = meanings[key]
            # The light of a flat goes with the f-number, the signal of a dark does not.
            amount = exact.time if black is None else exact.model_copy(update={"iso": None}).scale
            try:
                stack.append(gather(_pixels(session, shots), amount, black, nominal.tile))
            except ValueError as error:
                raise InputError(
                    f"{session.folder}: {shots[0].kind} shots of {shots[0].camera}: {error}."
                ) from error
        stacks.append(stack)
    few: list[list[npt.NDArray[np.uint16]]] = []
    if stacks[0] and emva.is_coarse(stacks[0]):
        few = [list(_pixels(session, shots[:COARSE])) for shots in groups[0].values()]
    return Frames(stacks[0], stacks[1], few)


def _groups(shots: Iterable[ShotRecord]) -> dict[Exposure, list[ShotRecord]]:
    groups: dict[Exposure, list[ShotRecord]] = {}
    for shot in shots:
        if shot.exposure is not None:
            groups.setdefault(shot.exposure, []).append(shot)
    return groups


def _pixels(session: Session, shots: Iterable[ShotRecord]) -> Iterator[npt.NDArray[np.uint16]]:
    for shot in shots:
        yield read_raw(session.file(shot)).pixels


def _blind(session: Session, views: Sequence[View], iso: float | None, nominal: Nominal) -> Blind | None:
    """Return the measurements from the brackets of the scene at one ISO; None without brackets."""
    usable = [
        (view, shots)
        for view in views
        if len(shots := [shot for shot in view.shots if shot.exposure and _iso(shot) == iso]) >= 2
    ]
    chosen = usable[:: max(len(usable) // VIEWS, 1)][:VIEWS]
    pairs = []
    for _, shots in chosen:
        ascending = sorted(shots, key=lambda shot: shot.exposure.scale if shot.exposure else 0.0)
        frames = [read_raw(session.file(shot)).pixels for shot in ascending]
        masks = [mask_of(session, shot, *frames[0].shape) for shot in ascending]
        for (shorter, below), (longer, above) in pairwise(zip(frames, masks, strict=True)):
            known = [counts for counts in (below, above) if counts is not None]
            both = np.logical_and.reduce(known) if known else None
            pair = brackets.compare(longer, shorter, nominal.black, nominal.white, both, nominal.tile)
            if pair is not None:
                pairs.append(pair)
    return brackets.pooled(pairs, nominal.white - float(nominal.black.mean())) if pairs else None


def _measured(value: tuple[float, float]) -> Measured:
    return Measured(value=value[0], sigma=value[1], source="brackets")


def _filled(measured: SensorCalibration, blind: Blind, nominal: Nominal) -> SensorCalibration:
    """Complete the measurements of darks and flats with those of the brackets."""
    additions: dict[str, object] = {}
    error = blind.black_error
    # A black that is not known to a tenth of a DN is left to the file.
    if measured.black is None and np.all(np.isfinite(error)) and float(error.max()) < 0.1:
        additions["black"] = emva.black_record(nominal.black + blind.black, error, nominal.tile, "brackets")
    if measured.ceiling is None and blind.plateau is not None:
        additions["ceiling"] = _measured((blind.plateau.level, blind.plateau.scatter))
    if blind.transfer is not None:
        if measured.gain is None or measured.gain.source == "brackets":
            additions["gain"] = _measured(brackets.gain(blind.transfer))
        read = brackets.read_noise(blind.transfer)
        if measured.read_noise is None and read is not None:
            additions["read_noise"] = _measured(read)
    if measured.linear is None:
        known = float(error[np.isfinite(error)].mean()) if np.isfinite(error).any() else emva.FILE_BLACK
        line = straightness(blind.levels, known / (nominal.white - float(nominal.black.mean())))
        if line is not None:
            additions |= {"nonlinearity": _measured((line.share, line.error)), "linear": line.linear}
    return measured.model_copy(update=additions)


def _lacking(
    name: str,
    iso: float | None,
    measured: SensorCalibration,
    of_iso: Sequence[Sequence[ShotRecord]],
    blind: Blind | None,
    others: bool,
) -> list[str]:
    where = f"{name} at ISO {iso:g}" if iso is not None else name
    words = []
    if others and not (of_iso[0] and of_iso[1]):
        lacks = " and ".join(
            kind for kind, shots in zip(("darks", "flats"), of_iso, strict=True) if not shots
        )
        words.append(f"{where} has no {lacks}")
    if measured.gain is None:
        reason = blind.reason if blind is not None and blind.reason else "no two exposures of a view overlap"
        words.append(f"{where}: gain and read noise are not determined ({reason})")
    return words
