"""Common parts of commands: a printed result; Ctrl-C; removal of incomplete output."""

import json
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imaging.errors import PartialError, RigError
from imaging.files import store
from rig.terminal.failures import Stopped
from rig.terminal.progress import StatusLine, is_main_process, status_line
from rig.terminal.streams import libraries_silenced, silence_stdout
from rig.terminal.text import plain, sentence


@dataclass
class CommandResult:
    """Result of a command: `data` for --json, `lines` for people, `missing` if not all is done."""

    data: dict[str, Any]
    lines: list[str] = field(default_factory=list)
    missing: str | None = None
    """One sentence that lists what is missing."""
    usable: bool = True
    """True if the output is usable although something is missing."""
    defect: bool = False
    """True if the missing part is a defect of rig."""
    already_there: bool = False
    """True if all of it was done before."""
    quiet: bool = False
    """True if the lines are not to be printed."""

    @property
    def exit_code(self) -> int:
        """0 done, 1 a defect of rig, 2 nothing usable, 3 done in part."""
        if self.missing is None:
            return 0
        return 1 if self.defect else 3 if self.usable else 2


def missing_parts(require_complete: Callable[[], None]) -> str | None:
    """Return what a stage's result says is missing, or None; `require_complete` raises PartialError if so."""
    try:
        require_complete()
    except PartialError as error:
        return str(error)
    return None


@contextmanager
def running(stage: str, go_on: str = "run the same command again") -> Iterator[StatusLine]:
    """Work on a stage: progress on standard error, libraries silent.

    go_on: what Ctrl-C says to do to continue.
    """
    with libraries_silenced() as stderr, status_line(stderr) as status:
        status.begin(stage)
        try:
            yield status
        except KeyboardInterrupt as error:
            raise Stopped(f"stopped; {go_on} to continue.") from error
        except Exception as error:
            error.add_note(status.stage.line())  # for the report, if it is a defect of rig
            raise


def for_each_scene(items: Sequence[Path], work: Callable[[Path], CommandResult], done: str) -> CommandResult:
    """The result of several scenes: their data in a list `scenes`, their lines one after the other.

    Where one of several fails, the others are still worked on; `done` is what it was not, in the sentence
    that says so.
    """
    outcomes, failures = [], []
    for item in items:
        try:
            outcomes.append(work(item))
        except RigError as error:
            if len(items) == 1:
                raise
            failures.append(str(error))
    missing = next((result.missing for result in outcomes if result.missing), None)
    if failures:
        missing = f"{len(failures)} of {len(items)} scenes could not be {done}: {failures[0]}"
    return CommandResult(
        {"scenes": [result.data for result in outcomes]},
        [line for result in outcomes for line in result.lines],
        missing,
        usable=bool(outcomes),
    )


def print_result(result: CommandResult, command: str, as_json: bool) -> int:
    """Print the result on standard output and what is missing on standard error; the exit code.

    StorageError: the file that standard output is has no room for it.
    """
    if not is_main_process():
        return result.exit_code
    if as_json:
        print_json({"command": command, "exit_code": result.exit_code} | result.data, result.missing)
    elif not result.quiet and result.lines:
        put("\n".join(map(plain, result.lines)))
    if result.missing is not None:
        print(sentence(result.missing), file=sys.stderr)
    return result.exit_code


def print_json(value: dict[str, Any], missing: str | None = None) -> None:
    """One JSON object on standard output."""
    if missing is not None:
        value = value | {"missing": missing}
    put(json.dumps(value, indent=1, allow_nan=False, default=str))


def put(text: str) -> None:
    """Print on standard output; a reader who has gone has seen enough. StorageError, as `print_result`."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        silence_stdout()
    except OSError as error:
        silence_stdout()
        raise store.refused("standard output", error) from error


@contextmanager
def removed_on_failure(folder: Path, unless: Callable[[Path], bool]) -> Iterator[None]:
    """Remove what the block created if it fails and `unless(folder)` finds nothing usable.

    A folder that was there before stays, and so do files that were in it.
    """
    before = set(folder.iterdir()) if folder.is_dir() else set()
    new = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        yield
    except BaseException:
        if folder.is_dir() and not unless(folder):
            for entry in set(folder.iterdir()) - before:
                _remove(entry)
            for path in new:
                try:
                    path.rmdir()
                except OSError:
                    break
        raise


def _remove(entry: Path) -> None:
    try:
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()
    except OSError:
        # The disk that refused the write refuses this too; the first error is the one that counts.
        pass
