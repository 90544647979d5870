"""A plan carried out: sessions are calibrated where they are not yet, scenes trained and exported."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from imaging.compute.workers import Task, Workers
from imaging.errors import RigError
from imaging.files import store
from imaging.progress import Progress, unreported
from rig.batch import forecasts
from rig.batch.batch_plan import BatchPlan, PlannedScene
from rig.batch.command_processes import Cost, Ended, run
from rig.batch.result import EXPORTS, BatchResult, BatchRow, Step, outcome
from rig.batch.storage import Place


@dataclass
class _Run:
    """A plan under way."""

    plan: BatchPlan
    workers: Workers
    progress: Progress
    say: Callable[[str], None]
    done: int = 0
    rows: dict[tuple[Path, int], BatchRow] = field(default_factory=dict)
    waiting: "dict[Future[Ended], Callable[[Future[Ended]], None]]" = field(default_factory=dict)

    def start(
        self, forecast: Callable[[], Task], words: Sequence[str], then: Callable[[Ended, Task], None]
    ) -> None:
        """Run a command when there is room for what it is forecast to take."""
        task = Task(0)
        try:
            task = forecast()
            future = self.workers.submit(task, run, words)
        except RigError as error:  # it fits nowhere, or the session is damaged
            future = Future()
            future.set_exception(error)
        self.waiting[future] = partial(_ended, then, task)

    def elsewhere(self, session: Path, place: Place) -> None:
        """A session in storage, alone, so that the disk here holds one: copied, carried out, and stored."""
        try:
            stored, shots = place.manifest(), place.shots_sha256()
            rows = [scene.made_in(stored.rows) for scene in self.plan.scenes]
            if None not in rows and stored.shots_sha256 == shots:
                for number, row in enumerate(filter(None, rows)):
                    self.finish(number, row.model_copy(update={"session": session, "already_there": True}))
                return
            place.fetch(session)
        except RigError as error:
            for number, scene in enumerate(self.plan.scenes):
                ended = Ended(error.exit_code, {}, str(error), 0.0)
                self.finish(number, _failed(session, scene, "fetch", ended))
            return
        self.begin(session)
        self.settle()
        self.store(session, place, shots)

    def store(self, session: Path, place: Place, shots_sha256: str) -> None:
        """Store what is made of a session, whose folder here goes when all scenes are."""
        rows = {key: row for key, row in self.rows.items() if key[0] == session}
        made = {key: _stored_at(row, place.target) for key, row in rows.items() if row.failed is None}
        if not made:
            return
        try:
            place.store(session, made.values(), shots_sha256)
        except RigError as error:
            self.say(f"{session}: store failed: {error}")
            failed = {"failed": "store", "says": str(error)}
            self.rows |= {key: rows[key].model_copy(update=failed) for key in made}
            return
        self.rows |= made
        if len(made) == len(rows):
            store.discard(session)

    def settle(self) -> None:
        """Go on until no command is under way."""
        while self.waiting:
            ended, _ = wait(self.waiting, return_when=FIRST_COMPLETED)
            for future in ended:
                self.waiting.pop(future)(future)
            self.result().write()

    def begin(self, session: Path) -> None:
        """A session's first step."""
        if (session / "calibration" / "calibration.json").is_file():
            self.train(session, None)
            return

        def calibrated(ended: Ended, task: Task) -> None:
            if ended.code in (0, 3):
                self.train(session, ended)
                return
            for number, scene in enumerate(self.plan.scenes):
                # The first scene has the cost of the one calibration.
                spent = ended if number == 0 else replace(ended, seconds=0.0, cost=Cost())
                self.finish(number, _failed(session, scene, "calibrate", spent))

        self.start(partial(forecasts.calibration, session), ["calibrate", str(session)], calibrated)

    def train(self, session: Path, before: Ended | None) -> None:
        """All scenes of a calibrated session. before: its calibration, unless that was there."""
        for number, scene in enumerate(self.plan.scenes):
            words = ["reconstruct", str(session), *scene.words()]
            then = self._trained(session, number, scene, before if number == 0 else None)
            self.start(partial(forecasts.training, session, scene, self.workers), words, then)

    def _trained(
        self, session: Path, number: int, scene: PlannedScene, before: Ended | None
    ) -> Callable[[Ended, Task], None]:
        def trained(ended: Ended, task: Task) -> None:
            if ended.code not in (0, 3) or "reconstruction" not in ended.data:
                self.finish(number, _failed(session, scene, "reconstruct", ended, task, before))
                return
            data = ended.data
            cost = ended.cost if before is None else before.cost + ended.cost
            partial = [one.says for one in (before, ended) if one is not None and one.code == 3]
            row = BatchRow(
                session=session,
                scene=scene.called,
                words=" ".join(scene.words()),
                reconstruction=data["reconstruction"],
                says=" ".join(partial),
                db=data.get("held_out_db"),
                width=data.get("width"),
                iterations=data.get("iterations"),
                report=data.get("report"),
                seconds=ended.seconds + (0.0 if before is None else before.seconds),
                attempts=ended.attempts,
                already_there=bool(data.get("already_there")),
                forecast=task.memory,
                peak=cost.peak,
                processor_seconds=cost.processor_seconds,
            )
            self.export(number, scene, row, scene.export)

        return trained

    def export(self, number: int, scene: PlannedScene, row: BatchRow, files: Sequence[str]) -> None:
        """The files that are still to be exported of a scene, one after the other."""
        assert row.reconstruction is not None  # it was trained
        if not files:
            self.finish(number, row)
            return
        out = row.session / EXPORTS / row.reconstruction.name / files[0]
        store.make_folder(out.parent)

        def exported(ended: Ended, task: Task) -> None:
            cost = Cost(row.processor_seconds, row.peak) + ended.cost
            more: dict[str, Any] = {
                "seconds": row.seconds + ended.seconds,
                "processor_seconds": cost.processor_seconds,
                "peak": cost.peak,
            }
            if ended.code == 0:
                more["exports"] = (*row.exports, out)
            else:
                more |= {"failed": "export", "says": ended.says}
            self.export(number, scene, row.model_copy(update=more), files[1:])

        words = ["export", str(row.reconstruction), "--out", str(out)]
        self.start(partial(forecasts.export, row.reconstruction), words, exported)

    def finish(self, number: int, row: BatchRow) -> None:
        """A scene is done, or has failed."""
        if row.stored is None:
            row = row.model_copy(update={"disk": _bytes(row.session)})
        self.rows[row.session, number] = row
        self.done += 1
        what = f"{row.failed} failed: {row.says}" if row.failed else outcome(row)
        if row.says and not row.failed:
            what += f"; made in part: {row.says}"
        self.say(f"{row.session}, {row.scene}: {what}")
        self.progress("scenes", self.done, self.total)

    @property
    def total(self) -> int:
        """Number of scenes in all."""
        return len(self.plan.sessions) * len(self.plan.scenes)

    def result(self) -> BatchResult:
        """Return what is done so far."""
        order = [
            (session, number) for session in self.plan.sessions for number in range(len(self.plan.scenes))
        ]
        rows = tuple(self.rows[key] for key in order if key in self.rows)
        return BatchResult(plan=self.plan.path, rows=rows, shard=self.plan.shard)


def carry_out(
    plan: BatchPlan,
    workers: Workers,
    *,
    on_progress: Progress = unreported,
    on_message: Callable[[str], None] = lambda line: None,
) -> BatchResult:
    """Carry out the rest of a plan; failures are recorded in their rows, and the rest goes on.

    Every step is a command of its own that resumes where it was stopped, so the same plan resumes too. As
    scenes are done, PLAN.batch.json is written, or PLAN.i-of-N.batch.json of a shard.
    """
    going = _Run(plan, workers, on_progress, on_message)
    on_progress("scenes", 0, going.total)
    for session in plan.sessions:
        if place := plan.place(session):
            going.elsewhere(session, place)
        else:
            going.begin(session)
    going.settle()
    going.result().write()
    return going.result()


def _bytes(folder: Path) -> int:
    """Bytes of the files in a folder."""
    return sum(os.path.getsize(path) for path in folder.rglob("*") if path.is_file())


def _stored_at(row: BatchRow, url: str) -> BatchRow:
    """Return a row whose paths are those of the stored files, from the URL of their folder."""

    def there(path: Path) -> Path:
        return Path(os.path.relpath(path, row.session))

    more = {name: there(path) for name in ("reconstruction", "report") if (path := getattr(row, name))}
    return row.model_copy(update={**more, "exports": tuple(map(there, row.exports)), "stored": url})


def _ended(then: Callable[[Ended, Task], None], task: Task, future: "Future[Ended]") -> None:
    """Go on with how a command ended, or with why it did not."""
    try:
        ended = future.result()
    except RigError as error:
        ended = Ended(error.exit_code, {}, str(error), 0.0)
    then(ended, task)


def _failed(
    session: Path,
    scene: PlannedScene,
    step: Step,
    ended: Ended,
    task: Task | None = None,
    before: Ended | None = None,
) -> BatchRow:
    """Return the row of a step that failed. before: the calibration, as `_Run.train` has it."""
    cost = ended.cost if before is None else before.cost + ended.cost
    return BatchRow(
        session=session,
        scene=scene.called,
        words=" ".join(scene.words()),
        failed=step,
        says=ended.says,
        seconds=ended.seconds + (0.0 if before is None else before.seconds),
        attempts=ended.attempts,
        forecast=task.memory if task is not None and task.memory else None,
        peak=cost.peak,
        processor_seconds=cost.processor_seconds,
    )
