"""The progress line on a terminal, drawn by rich."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TaskID
from rich.table import Column
from rich.text import Text

from rig.terminal.stage import Stage
from rig.terminal.text import duration, plain

ROOMY = 120
"""Fewest columns of a terminal at which a bar leaves the message room; narrower ones have the count alone."""


class _Words(ProgressColumn):
    """A part of the stage as text; a file name in it is never read as markup."""

    def __init__(self, stage: Stage, part: str, column: Column, roomy: bool = True) -> None:
        self.stage, self.part, self.roomy = stage, part, roomy
        super().__init__(table_column=column)

    def render(self, task: Task) -> Text:
        """The text now."""
        stage = self.stage
        if self.part == "stage":
            return Text(stage.name, style="bold")
        if self.part == "message":
            return Text(plain(stage.message), overflow="ellipsis", no_wrap=True)
        if self.part == "count":
            return Text(stage.counted(), style="cyan")
        remaining = stage.remaining()
        # On a narrow terminal the message needs the room of the time that has passed.
        past = duration(stage.elapsed()) if self.roomy or not remaining else ""
        ending = f"{duration(remaining)} left" if remaining else ""
        return Text(" · ".join(part for part in (past, ending) if part), style="dim")


class LiveStatusLine:
    """One line that moves, below the lines that stay."""

    def __init__(self, progress: Progress, stage: Stage) -> None:
        self.progress, self.stage = progress, stage
        self.task: TaskID = progress.add_task("", total=None, visible=False)

    def begin(self, name: str) -> None:
        """Start a stage."""
        self.stage.begin(name)
        self.progress.update(self.task, total=None, completed=0, visible=True)

    def __call__(self, message: str, done: int, total: int) -> None:
        """Move the line."""
        self.stage.move(message, done, total)
        self.progress.update(self.task, total=total if total > 0 else None, completed=done)

    def say(self, line: str) -> None:
        """Print a line above it that stays."""
        self.progress.console.print(Text(plain(line)))

    def ask(self, line: str) -> None:
        """Print what a person has to do."""
        self.say(line)


@contextmanager
def live_status_line(stream: TextIO) -> Iterator[LiveStatusLine]:
    """Draw on `stream` until the block ends; the moving line is then wiped."""
    stage, console = Stage(time.monotonic), Console(file=stream)
    roomy = console.width >= ROOMY
    columns: list[ProgressColumn] = [
        SpinnerColumn(),
        _Words(stage, "stage", Column(no_wrap=True)),
        _Words(stage, "message", Column(ratio=1, no_wrap=True, overflow="ellipsis")),
        _Words(stage, "count", Column(justify="right", no_wrap=True)),
        _Words(stage, "time", Column(no_wrap=True), roomy),
    ]
    if roomy:
        columns.insert(3, BarColumn(bar_width=24))
    progress = Progress(
        *columns,
        console=console,
        transient=True,
        expand=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )
    with progress:
        yield LiveStatusLine(progress, stage)
