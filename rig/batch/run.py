"""A plan carried out: sessions are calibrated where they are not yet, scenes trained and exported."""

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.record import Record
from rig.batch.plan import BatchPlan, PlannedScene
from rig.batch.processes import Ended, Submit

EXPORTS = "exports"
"""Folder of a session, with one of each scene for what is exported of it."""
Step = Literal["calibrate", "reconstruct", "export"]


class BatchRow(Record):
    """What came of a scene of a session, or of the calibration without which it has none.

    failed: the step that failed; says: why, in a sentence. seconds: of all steps, of the clock. attempts: of
    the step that took most. already_there: it was finished before.
    """

    session: Path
    scene: str
    reconstruction: Path | None = None
    failed: Step | None = None
    says: str = ""
    db: float | None = None
    iterations: int | None = None
    report: Path | None = None
    exports: tuple[Path, ...] = ()
    seconds: float = 0.0
    attempts: int = 1
    already_there: bool = False


class BatchResult(Record):
    """`PLAN.batch.json`: a row for each scene of each session, in the order of the plan."""

    plan: Path
    rows: tuple[BatchRow, ...]


@dataclass
class _Run:
    """A plan under way."""

    plan: BatchPlan
    submit: Submit
    progress: Progress
    say: Callable[[str], None]
    done: int = 0
    rows: dict[tuple[Path, int], BatchRow] = field(default_factory=dict)
    waiting: "dict[Future[Ended], Callable[[Ended], None]]" = field(default_factory=dict)

    def start(self, words: Sequence[str], then: Callable[[Ended], None]) -> None:
        self.waiting[self.submit(words)] = then

    def begin(self, session: Path) -> None:
        """A session's first step."""
        if (session / "calibration" / "calibration.json").is_file():
            self.train(session, 0.0)
            return

        def calibrated(ended: Ended) -> None:
            if ended.code in (0, 3):
                self.train(session, ended.seconds)
                return
            for number, scene in enumerate(self.plan.scenes):
                self.finish(number, _failed(session, scene, "calibrate", ended))

        self.start(["calibrate", str(session)], calibrated)

    def train(self, session: Path, before: float) -> None:
        """All scenes of a calibrated session. before: seconds that its calibration took."""
        for number, scene in enumerate(self.plan.scenes):
            words = ["reconstruct", str(session), *scene.words()]
            self.start(words, self._trained(session, number, scene, before if number == 0 else 0.0))

    def _trained(
        self, session: Path, number: int, scene: PlannedScene, before: float
    ) -> Callable[[Ended], None]:
        def trained(ended: Ended) -> None:
            if ended.code not in (0, 3) or "reconstruction" not in ended.data:
                self.finish(number, _failed(session, scene, "reconstruct", ended))
                return
            data = ended.data
            row = BatchRow(
                session=session,
                scene=scene.called,
                reconstruction=data["reconstruction"],
                says=ended.says if ended.code == 3 else "",
                db=data.get("held_out_db"),
                iterations=data.get("iterations"),
                report=data.get("report"),
                seconds=before + ended.seconds,
                attempts=ended.attempts,
                already_there=bool(data.get("already_there")),
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

        def exported(ended: Ended) -> None:
            if ended.code == 0:
                more = {"exports": (*row.exports, out), "seconds": row.seconds + ended.seconds}
            else:
                more = {"failed": "export", "says": ended.says, "seconds": row.seconds + ended.seconds}
            self.export(number, scene, row.model_copy(update=more), files[1:])

        self.start(["export", str(row.reconstruction), "--out", str(out)], exported)

    def finish(self, number: int, row: BatchRow) -> None:
        """A scene is done, or has failed."""
        self.rows[row.session, number] = row
        self.done += 1
        what = f"{row.failed} failed: {row.says}" if row.failed else told(row)
        self.say(f"{row.session}, {row.scene}: {what}")
        self.progress("scenes", self.done, self.total)

    @property
    def total(self) -> int:
        """How many scenes there are to be."""
        return len(self.plan.sessions) * len(self.plan.scenes)

    def result(self) -> BatchResult:
        """What is done so far."""
        order = [(session, number) for session in self.plan.sessions for number in range(self.total)]
        rows = tuple(self.rows[key] for key in order if key in self.rows)
        return BatchResult(plan=self.plan.path, rows=rows)


def carry_out(
    plan: BatchPlan,
    submit: Submit,
    *,
    on_progress: Progress = unreported,
    on_message: Callable[[str], None] = lambda line: None,
) -> BatchResult:
    """Do all of a plan that is not done yet; what fails is told in its row, and the rest goes on.

    Every step is a command of its own that goes on where it was stopped, so the same plan does so too. As
    scenes are done, PLAN.batch.json is written.
    """
    run = _Run(plan, submit, on_progress, on_message)
    on_progress("scenes", 0, run.total)
    for session in plan.sessions:
        run.begin(session)
    while run.waiting:
        ended, _ = wait(run.waiting, return_when=FIRST_COMPLETED)
        for future in ended:
            run.waiting.pop(future)(future.result())
        store.write_json(record_path(plan.path), run.result().model_dump(mode="json"))
    return run.result()


def record_path(plan: Path) -> Path:
    """Where the outcome of a plan is kept."""
    return plan.with_suffix(".batch.json")


def told(row: BatchRow) -> str:
    """How good a scene became, in a few words."""
    words = [] if row.db is None else [f"held-out {row.db:.1f} dB"]
    words += ["already there"] if row.already_there else [f"{row.seconds:.0f} s"]
    words += [f"{row.attempts} attempts"] if row.attempts > 1 else []
    return ", ".join(words)


def _failed(session: Path, scene: PlannedScene, step: Step, ended: Ended) -> BatchRow:
    return BatchRow(
        session=session,
        scene=scene.called,
        failed=step,
        says=ended.says,
        seconds=ended.seconds,
        attempts=ended.attempts,
    )
