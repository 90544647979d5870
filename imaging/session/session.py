"""A session folder: opened, read and appended to."""

from collections import Counter
from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Self

from imaging.choices import Subject
from imaging.errors import InputError
from imaging.files import store
from imaging.record import parse
from imaging.session.lamps import LampsRecord
from imaging.session.paths import not_a_session
from imaging.session.records import (
    CameraRecord,
    PlanRecord,
    RunRecord,
    SessionRecord,
    ShotRecord,
    SplitRecord,
)
from imaging.session.turntable import TurntableRecord
from imaging.session.view_id import ViewId

SESSION = "session.json"
SPLIT = "split.json"
TURNTABLE = "turntable.json"
LAMPS = "lamps.json"
_SHOTS: dict[Subject, str] = {"scene": "shot", "dark": "dark", "flat": "flat", "board": "board shot"}


class Session:
    """A session on disk. Holds no state but its identity; every read sees what is there now."""

    def __init__(self, folder: Path, record: SessionRecord) -> None:
        self.folder = folder
        self.record = record

    @classmethod
    def create(cls, folder: Path, record: SessionRecord) -> Self:
        """Begin a session in a new or empty folder; InputError if one is already there."""
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(f"{folder} is not empty: name a new folder, or --resume the session in it.")
        store.make_folder(folder)
        store.write_json(folder / SESSION, record.model_dump(mode="json"))
        return cls(folder, record)

    @classmethod
    def open(cls, folder: str | PathLike[str]) -> Self:
        """Open an existing session; InputError with the reason if it is not one."""
        folder = Path(folder)
        if not folder.is_dir():
            raise InputError(
                f"{folder} is not a folder: name a session made by `rig capture` or `rig import`."
            )
        path = folder / SESSION
        if not path.exists():
            raise not_a_session(folder)
        return cls(folder, parse(SessionRecord, store.read_json(path), path))

    def __fspath__(self) -> str:
        """The session's folder: a session stands wherever a path to it does."""
        return str(self.folder)

    def __repr__(self) -> str:
        return f"<Session {self.summary()}>"

    def summary(self) -> str:
        """The session in a line: its folder, and how much of what it holds."""
        kinds = Counter(shot.kind for shot in self.shots())
        counts = [(len(self.record.cameras), "camera")]
        counts += [(kinds[kind], noun) for kind, noun in _SHOTS.items() if kinds[kind] or kind == "scene"]
        return " · ".join([str(self.folder), *(f"{n} {noun}{'' if n == 1 else 's'}" for n, noun in counts)])

    def plans(self) -> list[PlanRecord]:
        """Every plan, in order; of two with one name the later counts."""
        path = self.folder / "plans.jsonl"
        plans = [parse(PlanRecord, value, path) for value in store.read_lines(path)]
        return list({plan.plan: plan for plan in plans}.values())

    def shots(self, kind: str | None = None) -> list[ShotRecord]:
        """Every shot (of a kind); of two records of the same shot the later counts."""
        path = self.folder / "shots.jsonl"
        shots = [parse(ShotRecord, value, path) for value in store.read_lines(path)]
        unique = {shot.identity: shot for shot in shots}
        return [shot for shot in unique.values() if kind is None or shot.kind == kind]

    def runs(self) -> list[RunRecord]:
        """Every run that took shots, in order."""
        path = self.folder / "runs.jsonl"
        return [parse(RunRecord, value, path) for value in store.read_lines(path)]

    def photograph_names(self) -> dict[ViewId, str]:
        """The views that were imported, by the names that users gave their first photographs."""
        names: dict[ViewId, str] = {}
        for shot in self.shots("scene"):
            if shot.source is not None:
                names.setdefault(ViewId(shot.frame, shot.camera), Path(shot.source).name)
        return names

    def split(self) -> SplitRecord | None:
        """Return the data set's split into training and test views; None if it has none."""
        path = self.folder / SPLIT
        return parse(SplitRecord, store.read_json(path), path) if path.exists() else None

    def turntable(self) -> TurntableRecord | None:
        """Return the stated angles of a turntable; None if cameras or things were not turned by one."""
        path = self.folder / TURNTABLE
        return parse(TurntableRecord, store.read_json(path), path) if path.exists() else None

    def lamps(self) -> LampsRecord | None:
        """Return the known lamps of a light dome; None if the light stayed the same."""
        path = self.folder / LAMPS
        return parse(LampsRecord, store.read_json(path), path) if path.exists() else None

    def append_plan(self, plan: PlanRecord) -> None:
        """Record what a run is about to shoot."""
        store.append_line(self.folder / "plans.jsonl", plan.model_dump(mode="json"))

    def append_run(self, run: RunRecord) -> None:
        """Record a run that is over."""
        store.append_line(self.folder / "runs.jsonl", run.model_dump(mode="json", exclude_none=True))

    def append_shot(self, shot: ShotRecord) -> None:
        """Record a shot whose file is already whole on the disk."""
        store.append_line(self.folder / "shots.jsonl", shot.model_dump(mode="json", exclude_none=True))

    def file(self, shot: ShotRecord) -> Path:
        """Return where a shot's file is; InputError if the record leads out of the session."""
        return store.inside(self.folder, shot.file)

    def mask(self, shot: ShotRecord) -> Path | None:
        """Path of a shot's mask, or None. InputError if the record leads out of the session."""
        return None if shot.mask is None else store.inside(self.folder, shot.mask)

    def depth(self, shot: ShotRecord) -> Path | None:
        """Return the path of a shot's depth map, or None. Errors as `mask`."""
        return None if shot.depth is None else store.inside(self.folder, shot.depth)

    def camera(self, name: str) -> CameraRecord:
        """The camera of that name; InputError if the session has none."""
        for camera in self.record.cameras:
            if camera.name == name:
                return camera
        raise InputError(f"{self.folder} has no camera {name!r}: correct shots.jsonl or session.json.")


def brackets(shots: Iterable[ShotRecord]) -> dict[ViewId, list[ShotRecord]]:
    """Shots grouped by view, each group in order of its steps, groups in order."""
    groups: dict[ViewId, list[ShotRecord]] = {}
    for shot in sorted(shots, key=lambda shot: (shot.view, shot.step)):
        groups.setdefault(shot.view, []).append(shot)
    return groups
