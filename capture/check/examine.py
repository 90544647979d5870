"""One bracket after the other is read and compared within itself; what is kept of it is small."""

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from capture.check import developed_ratios, focus, motion
from capture.check.exposure_estimates import ExposureEstimate, estimates, meant, raw_edges
from capture.check.findings import ProblemKind, ShotLook
from capture.pictures.read import Examined, PictureFacts, examine
from capture.pictures.reduced_pictures import ReducedPicture
from imaging.arrays import Mask
from imaging.errors import InputError
from imaging.files import store
from imaging.merge.masks import mask_of
from imaging.optics.exposure import Exposure
from imaging.session.records import ShotRecord
from imaging.session.session import Session

ELSEWHERE = 0.3
"""Share of moved pixels beyond which two exposures do not show the same scene, and give no ratio."""
MOST_THREADS = 4
MOST_CURVED = 8
"""Brackets from which the curve of a camera is found, evenly chosen."""
COMPARED = frozenset(("scene", "board"))
"""Kinds of shots in which something can be in focus, and stand still."""

Shots = Sequence[ShotRecord]


@dataclass(frozen=True)
class Read:
    """A file that could be read, and what it shows."""

    picture: PictureFacts
    sha256: str
    look: ShotLook
    thumbnail: bytes


class _Comparable(NamedTuple):
    """A shot that can be compared with the rest of its bracket."""

    shot: ShotRecord
    picture: PictureFacts
    reduced: ReducedPicture


Failure = tuple[ProblemKind, str]
"""Problem of a file, and a clause that states it."""


@dataclass(frozen=True, eq=False)
class _Undecided:
    """Bracket of developed photographs, whose exposures can be estimated once the camera's curve is known."""

    camera: str
    files: list[str]
    labels: list[Exposure]
    codes: developed_ratios.BracketCodes


@dataclass(frozen=True, eq=False)
class _Bracket:
    """The shots of one bracket, by file."""

    read: dict[str, Read]
    failed: dict[str, Failure]
    undecided: _Undecided | None


def examine_all(
    session: Session, shots: Shots, started: Callable[[ShotRecord], None]
) -> tuple[dict[str, Read], dict[str, Failure]]:
    """Every shot by file; `started` is called before each is read, by one thread at a time."""
    groups: dict[tuple[str, str, int, str, str | None], list[ShotRecord]] = {}
    for shot in {shot.file: shot for shot in shots}.values():
        groups.setdefault((shot.kind, shot.plan, shot.frame, shot.camera, shot.band), []).append(shot)
    lock = threading.Lock()

    def examine_group(group: Shots) -> _Bracket:
        return _examine(session, group, lock, started)

    pool = ThreadPoolExecutor(min(MOST_THREADS, os.cpu_count() or 1))
    try:
        brackets = list(pool.map(examine_group, groups.values()))
    finally:
        pool.shutdown(cancel_futures=True)
    read = {file: content for bracket in brackets for file, content in bracket.read.items()}
    failed = {file: reason for bracket in brackets for file, reason in bracket.failed.items()}
    for file, estimate in _developed(brackets):
        read[file] = replace(read[file], look=_with(read[file].look, estimate))
    return read, failed


def _examine(
    session: Session, group: Shots, lock: threading.Lock, started: Callable[[ShotRecord], None]
) -> _Bracket:
    examined: list[tuple[ShotRecord, Examined]] = []
    digests: dict[str, str] = {}
    failed: dict[str, Failure] = {}
    for shot in sorted(group, key=lambda shot: shot.step):
        with lock:
            started(shot)
        content = _read(session, shot)
        if isinstance(content, Examined):
            examined.append((shot, content))
            digests[shot.file] = store.sha256(session.file(shot))
        else:
            failed[shot.file] = content
    looks = {shot.file: _look(shot, content.picture) for shot, content in examined}
    undecided = None
    if group[0].kind in COMPARED:
        same = [
            _Comparable(shot, content.picture, content.reduced)
            for shot, content in examined
            if content.reduced is not None and digests[shot.file] == shot.sha256
        ]
        looks |= _compared(same, looks)
        undecided = _estimated(same, looks)
    read = {
        shot.file: Read(content.picture, digests[shot.file], looks[shot.file], content.thumbnail)
        for shot, content in examined
    }
    return _Bracket(read, failed, undecided)


def _read(session: Session, shot: ShotRecord) -> Examined | Failure:
    try:
        path = session.file(shot)
    except InputError:
        return "index", f"shots.jsonl names {shot.file!r}, which leads out of the session"
    if not path.is_file():
        return "absent", f"{shot.file} is missing"
    try:
        return examine(path, _counts(session, shot))
    except InputError as error:
        return "torn", f"{shot.file} cannot be read to its end ({str(error).split(': ')[0]})"


def _counts(session: Session, shot: ShotRecord) -> Mask | None:
    """Return what the mask of a shot lets through; None without one, or with one that cannot be read."""
    try:
        return mask_of(session, shot, shot.height, shot.width)
    except InputError:
        return None


def _look(shot: ShotRecord, picture: PictureFacts) -> ShotLook:
    return ShotLook(
        kind=shot.kind,
        picture=picture.kind,
        file=shot.file,
        camera=shot.camera,
        frame=shot.frame,
        step=shot.step,
        width=picture.width,
        height=picture.height,
        requested=shot.requested,
        reported=shot.reported or picture.metadata.exposure,
        clipped=picture.clipped,
        black=picture.black,
        lit=picture.lit,
    )


def label(look: ShotLook) -> Exposure | None:
    """Return what the shot claims: reported by its record or its file, else requested."""
    return look.reported or look.requested


def _compared(shots: Sequence[_Comparable], looks: dict[str, ShotLook]) -> dict[str, ShotLook]:
    """Focus and motion of the shots of one bracket."""
    details = {shot.file: focus.detail(reduced) for shot, _, reduced in shots}
    facts = {}
    for file, detail in details.items():
        others = [other for name, other in details.items() if name != file]
        facts[file] = looks[file].model_copy(
            update={
                "sharpness": focus.sharpness(detail),
                "relative_sharpness": focus.against(detail, others),
            }
        )
    for longer, shorter in pairwise(_longest_first(shots, looks)):
        shot = shorter.shot
        if longer.picture.kind != shorter.picture.kind:
            continue
        moved = motion.compare(longer.reduced, shorter.reduced)
        if moved is not None:
            motion_facts = {"shift": moved.shift, "shift_error": moved.error, "moved": moved.moved}
            facts[shot.file] = facts[shot.file].model_copy(update=motion_facts)
    return facts


def _longest_first(shots: Sequence[_Comparable], looks: dict[str, ShotLook]) -> list[_Comparable]:
    """Sort by label; where labels lack, by brightness."""
    labels = [label(looks[frame.shot.file]) for frame in shots]
    if all(labels):
        scale = {frame.shot.file: stated.scale for frame, stated in zip(shots, labels, strict=True) if stated}
    else:
        scale = {frame.shot.file: float(frame.reduced.green.mean()) for frame in shots}
    return sorted(shots, key=lambda frame: -scale[frame.shot.file])


def _estimated(shots: Sequence[_Comparable], looks: dict[str, ShotLook]) -> _Undecided | None:
    """Estimates of a RAW bracket go into `looks`; of a developed one the codes are kept for later."""
    labelled = [
        (frame, exposure) for frame in shots if (exposure := label(looks[frame.shot.file])) is not None
    ]
    if len(labelled) < 2 or len({frame.picture.kind for frame, _ in labelled}) > 1:
        return None
    if len({(frame.picture.width, frame.picture.height) for frame, _ in labelled}) > 1:
        return None
    if any((looks[frame.shot.file].moved or 0.0) > ELSEWHERE for frame, _ in labelled):
        return None
    files, exposures = [frame.shot.file for frame, _ in labelled], [exposure for _, exposure in labelled]
    frames = [frame.reduced.linear for frame, _ in labelled if frame.reduced.linear is not None]
    if len(frames) == len(labelled):
        edges = raw_edges(frames, np.log([exposure.scale for exposure in exposures]))
        for file, estimate in zip(files, estimates(exposures, edges), strict=True):
            looks[file] = _with(looks[file], estimate)
        return None
    patches = [frame.reduced.patches for frame, _ in labelled if frame.reduced.patches is not None]
    if len(patches) < len(labelled):
        return None
    return _Undecided(
        shots[0].shot.camera, files, exposures, developed_ratios.codes_of(patches, meant(exposures))
    )


def _developed(brackets: Sequence[_Bracket]) -> Iterable[tuple[str, ExposureEstimate | None]]:
    """Estimates of the shots that cameras developed: the curve of a camera is that of all its brackets."""
    by_camera: dict[str, list[_Undecided]] = {}
    for bracket in brackets:
        if bracket.undecided is not None:
            by_camera.setdefault(bracket.undecided.camera, []).append(bracket.undecided)
    for of_camera in by_camera.values():
        curves = developed_ratios.curves(
            [waiting.codes for waiting in of_camera[:: -(-len(of_camera) // MOST_CURVED)]]
        )
        if curves is None:
            continue
        for waiting in of_camera:
            estimated = estimates(waiting.labels, developed_ratios.edges(waiting.codes, curves))
            yield from zip(waiting.files, estimated, strict=True)


def _with(look: ShotLook, estimate: ExposureEstimate | None) -> ShotLook:
    if estimate is None:
        return look
    return look.model_copy(
        update={
            "estimated": estimate.exposure,
            "off": estimate.over_meant,
            "estimate_error": estimate.error,
        }
    )
