"""Result of a batch: a row for each scene of each session, and its record beside the plan."""

from pathlib import Path
from typing import Literal

from imaging.compute import memory
from imaging.files import store
from imaging.record import Record

EXPORTS = "exports"
"""Folder of a session, with one of each scene for what is exported of it."""
Step = Literal["fetch", "calibrate", "reconstruct", "export", "store"]


class BatchRow(Record):
    """Result of a scene of a session, or of the calibration without which it has none.

    failed: the step that failed; says: why, in a sentence, or what it lacks where it was made in part.
    seconds: of all steps, of the clock. attempts: of the step that took most. already_there: it was finished
    before. forecast: bytes of memory that its training was said to take. stored: URL of a folder in storage,
    from which the other paths hold then. words: options of `rig reconstruct` that it was made with.
    """

    session: Path
    scene: str
    words: str = ""
    reconstruction: Path | None = None
    failed: Step | None = None
    says: str = ""
    db: float | None = None
    width: int | None = None
    """px that `db` holds at."""
    iterations: int | None = None
    report: Path | None = None
    exports: tuple[Path, ...] = ()
    seconds: float = 0.0
    attempts: int = 1
    already_there: bool = False
    forecast: int | None = None
    peak: int | None = None
    processor_seconds: float | None = None
    disk: int | None = None
    """Bytes of the session's folder at the end of the step, with all that is in it."""
    stored: str | None = None

    @property
    def place(self) -> str:
        """Folder or URL of what was made."""
        return self.stored or str(self.session)

    @property
    def quality(self) -> str:
        """Held-out dB with the width that they hold at; empty where nothing was measured."""
        if self.db is None:
            return ""
        return f"{self.db:.1f} dB" + (f" at {self.width} px" if self.width else "")


class BatchResult(Record):
    """`PLAN.batch.json`: a row for each scene of each session, in the order of the plan.

    shard: "3/8" of a result that holds the third of eight parts of the sessions.
    """

    plan: Path
    rows: tuple[BatchRow, ...]
    shard: str | None = None

    def path(self, suffix: str) -> Path:
        """Return PLAN.batch.SUFFIX beside the plan, or PLAN.3-of-8.batch.SUFFIX of a shard."""
        part = "" if self.shard is None else f".{self.shard.replace('/', '-of-')}"
        return self.plan.with_suffix(f"{part}.batch{suffix}")

    def write(self) -> None:
        """Write the record beside the plan."""
        store.write_json(self.path(".json"), self.model_dump(mode="json"))


def outcome(row: BatchRow) -> str:
    """Return how good a scene became, in a few words."""
    words = [] if row.db is None else [f"held-out {row.quality}"]
    words += ["already there"] if row.already_there else [f"{row.seconds:.0f} s"]
    words += [f"{row.attempts} attempts"] if row.attempts > 1 else []
    words += [] if row.forecast is None else [f"forecast {memory.text(row.forecast)}"]
    return ", ".join(words)
