"""`PLAN.toml`: sessions, and the scenes that are to be made of each."""

import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from capture.rigfile.toml_lines import key_lines, line_of
from imaging.errors import InputError
from imaging.session.records import Name
from imaging.session.session import SESSION
from recon.decide.cost.budget import Budget
from recon.decide.overrides import Overrides
from recon.decide.presets import MethodName, QualityName
from recon.decide.request import TrainingRequest
from rig.batch import storage
from rig.batch.result import BatchRow

EXAMPLE = 'sessions = ["scans/*"]'
OUTPUT = 'output = "s3://bucket/scenes"'


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PlannedScene(_Table):
    """Scene of each session: the options of `rig reconstruct`, and the files that are exported of it.

    export: names of files, whose extensions select their formats, as in `rig export --out` has them.
    """

    name: Name | None = None
    method: MethodName = TrainingRequest.method
    quality: QualityName = TrainingRequest.quality
    budget: str | None = None
    early_stop: Annotated[bool, Field(strict=True)] = TrainingRequest.early_stop
    all_views: Annotated[bool, Field(strict=True)] = TrainingRequest.all_views
    seed: Annotated[int, Field(strict=True, ge=0)] = TrainingRequest.seed
    set: dict[str, str | int | float | bool] = {}
    export: tuple[Annotated[str, Field(pattern=r"^[^/\\]+\.[^/\\]+$")], ...] = ()

    def request(self) -> TrainingRequest:
        """The training that it asks for; InputError where a setting or the budget is not possible."""
        return TrainingRequest(
            method=self.method,
            quality=self.quality,
            budget=None if self.budget is None else Budget.parse(self.budget),
            seed=self.seed,
            overrides=Overrides.of(self.sets()),
            early_stop=self.early_stop,
            all_views=self.all_views,
            name=self.name,
        )

    def words(self) -> list[str]:
        """Return what `rig reconstruct` is given beside the session."""
        words = ["--method", self.method, "--quality", self.quality, "--seed", str(self.seed)]
        words += ["--early-stop"] if self.early_stop else []
        words += ["--all-views"] if self.all_views else []
        words += [] if self.budget is None else ["--budget", self.budget]
        words += [] if self.name is None else ["--name", self.name]
        for one in self.sets():
            words += ["--set", one]
        return words

    def sets(self) -> list[str]:
        """Settings in the form of `--set`."""
        return [
            f"{key}={int(value) if isinstance(value, bool) else value}" for key, value in self.set.items()
        ]

    def made_in(self, rows: Sequence[BatchRow]) -> BatchRow | None:
        """Return the row of this scene among those of a session, unless it is not made or lacks an export.

        A row of the same name that was made with other options is another scene's.
        """
        return next(
            (
                row
                for row in rows
                if row.scene == self.called
                and row.words == " ".join(self.words())
                and row.failed is None
                and set(self.export) <= {path.name for path in row.exports}
            ),
            None,
        )

    @property
    def called(self) -> str:
        """Name that distinguishes it from the other scenes of a plan."""
        return self.name or " ".join([self.method, self.quality, *([self.budget] if self.budget else [])])


class _Tables(_Table):
    sessions: Annotated[tuple[str, ...], Field(min_length=1)]
    output: str | None = None
    scene: Annotated[tuple[PlannedScene, ...], Field(min_length=1)] = (PlannedScene(),)


@dataclass(frozen=True)
class BatchPlan:
    """Plan of a batch: every scene of every session.

    sessions: folders, each once. shard: "3/8" of the third of eight parts of a plan. output: URL of the
    folder in storage of what is made of sessions that are in storage too; their folders here are for the work
    on them. sources: URLs of such sessions by the names of their folders.
    """

    path: Path
    sessions: tuple[Path, ...]
    scenes: tuple[PlannedScene, ...]
    shard: str | None = None
    output: str | None = None
    sources: dict[str, str] = field(default_factory=dict)

    def place(self, session: Path) -> storage.Place | None:
        """Return where a session is in storage; None for one that is a folder here."""
        if self.output is None:
            return None
        return storage.Place(self.sources[session.name], f"{self.output}/{session.name}")


def read_plan(path: str | Path) -> BatchPlan:
    """A plan that can be carried out; InputError of one sentence that names the line at fault.

    Sessions are folders beside the plan, or patterns of them such as `scans/*`; or URLs in object storage.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        value = tomllib.loads(text)
        lines = key_lines(text)
    except OSError as error:
        reason = (error.strerror or "it cannot be read").lower()
        raise InputError(
            f"{path} cannot be read ({reason}): name a plan, such as a file with {EXAMPLE}."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path} is not TOML ({error}): correct it there.") from None
    try:
        tables = _Tables.model_validate(value)
    except ValidationError as error:
        first = min(error.errors(), key=lambda one: one["type"] == "missing")
        keys = tuple(key for key in first["loc"] if isinstance(key, str | int))
        where = f"{path}, line {line_of(lines, keys)}"
        if first["type"] == "extra_forbidden":
            raise InputError(f"{where}: there is no setting {keys[-1]!r}: correct its name.") from None
        if first["type"] == "missing":
            raise InputError(f"{where}: {keys[-1]} is missing: add it, such as {EXAMPLE}.") from None
        what = ".".join(map(str, keys))
        if first["type"] == "too_short":
            fixes = {"sessions": f"add one, such as {EXAMPLE}", "scene": "add a [[scene]], or leave it out"}
            raise InputError(f"{where}: {what} is empty: {fixes[what]}.") from None
        raise InputError(f"{where}: {what}: {first['msg'].lower()}; correct it.") from None
    for number, scene in enumerate(tables.scene):
        try:
            scene.request()
        except InputError as error:
            raise InputError(f"{path}, line {line_of(lines, ('scene', number))}: {error}") from None
    called, count = Counter(scene.called for scene in tables.scene).most_common(1)[0]
    if count > 1:
        raise InputError(f"{path} has {count} scenes named {called!r}: give each a different name.")
    line = line_of(lines, ("sessions",))
    if tables.output is None and not any(map(storage.is_url, tables.sessions)):
        return BatchPlan(path, _sessions(path, tables.sessions, line), tables.scene)
    if tables.output is None:
        raise InputError(
            f"{path}, line {line}: sessions in storage need an output: add one, such as {OUTPUT}."
        )
    if not all(map(storage.is_url, [tables.output, *tables.sessions])):
        line = line_of(lines, ("output",))
        raise InputError(
            f"{path}, line {line}: output and all sessions must be in storage: give URLs, such as {OUTPUT}."
        )
    sources = _sources(path, tables.sessions, line)
    folders = tuple(path.with_suffix(".work") / name for name in sources)
    return BatchPlan(path, folders, tables.scene, output=tables.output.rstrip("/"), sources=sources)


def _sources(path: Path, patterns: tuple[str, ...], line: int) -> dict[str, str]:
    """URLs of the sessions that are meant, by their names, in the order of the plan."""
    sources: dict[str, str] = {}
    for pattern in patterns:
        urls = storage.sessions_at(pattern)
        if not urls:
            raise InputError(f"{path}, line {line}: there is no session at {pattern!r}: correct it.")
        for url in urls:
            name = url.rsplit("/", 1)[-1]
            if sources.setdefault(name, url) != url:
                raise InputError(
                    f"{path}, line {line}: {sources[name]} and {url} would both be stored as {name}: put one "
                    "of them in another plan, with an output of its own."
                )
    return sources


def _sessions(path: Path, patterns: tuple[str, ...], line: int) -> tuple[Path, ...]:
    """The folders that are meant, in the order of the plan."""
    sessions: dict[Path, Path] = {}
    for pattern in patterns:
        folder = path.parent / pattern
        base = Path(folder.anchor) if Path(pattern).is_absolute() else path.parent
        try:
            # A folder may have brackets in its name, which a pattern takes for a set of letters.
            literal = (folder / SESSION).is_file()
            some = [folder] if literal else sorted(base.glob(pattern.removeprefix(folder.anchor)))
        except (ValueError, NotImplementedError) as error:
            raise InputError(
                f"{path}, line {line}: {pattern!r} is not a pattern of folders ({error})."
            ) from None
        some = [one for one in some if (one / SESSION).is_file()]
        if not some:
            raise InputError(
                f"{path}, line {line}: {pattern!r} is not a session relative to {path.name}: correct it, or "
                "make one with rig import or rig capture."
            )
        for one in some:
            sessions.setdefault(one.resolve(), one)
    return tuple(sessions.values())
