"""The session of an import, written with what came with its photographs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from capture.imports.copying import Place, append_plans, begin_or_continue, copy_all, take_back
from capture.imports.given.given_calibration import FILE as CALIBRATION
from capture.imports.given.given_calibration import has_poses, write_given, write_truth
from capture.imports.given.given_split import write_split
from capture.imports.layouts.given import Given
from capture.record.new_session import folder_made
from imaging.files import store
from imaging.progress import Progress
from imaging.session.lock import sole_writer
from imaging.session.records import Band, CameraRecord, PlanRecord
from imaging.session.session import TURNTABLE


@dataclass(frozen=True)
class Written:
    """Result of the copying. views: that came with a pose. unread: a sentence for each file left out."""

    views: int
    unread: Sequence[str]
    notes: Sequence[str]


def write_session(
    out: Path,
    cameras: tuple[CameraRecord, ...],
    plans: list[PlanRecord],
    places: list[Place],
    given: Given | None,
    filters: tuple[Band, ...],
    on_progress: Progress,
) -> Written:
    """Write the session, or complete it; what was begun here is taken back if that fails."""
    # The file that is written last makes a session; a killed import lacks it and is completed.
    last = CALIBRATION if has_poses(given) else "session.json"
    notes: list[str] = []
    with folder_made(out), sole_writer(out):
        session, begun_here = begin_or_continue(out, cameras, plans, places, last, filters)
        try:
            append_plans(session, plans)
            if given is not None:
                notes += write_split(session, given, places)
                notes += write_truth(session, given, places)
                if given.turntable is not None:
                    store.write_json(out / TURNTABLE, given.turntable.model_dump(mode="json"))
            unread, moved = copy_all(session, places, on_progress)
            notes += moved
            views = 0
            if given is not None and has_poses(given):
                on_progress("writing the calibration", 0, 1)
                views = len(write_given(session, given, places).views)
                on_progress("writing the calibration", 1, 1)
        except BaseException as error:
            if begun_here and not isinstance(error, KeyboardInterrupt):
                take_back(out)
            raise
    return Written(views, unread, notes)
