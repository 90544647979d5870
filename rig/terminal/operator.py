"""Operator at the terminal: asked to place targets before the cameras, and to confirm."""

import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Literal

from drivers.clock import Clock
from imaging.choices import Subject
from imaging.errors import InputError

DO: dict[Subject, str] = {
    "dark": "Darks: cover every lens, and the viewfinders of still cameras.",
    "flat": "Flats: have something evenly lit and white fill the picture of every camera, out of focus.",
    "board": "Board: hold the calibration board where the cameras see it.",
}
NEXT: dict[Subject, str] = {
    "scene": "Frame {frame}: move the rig, or what it looks at.",
    "board": "Frame {frame}: hold the board elsewhere, tilted otherwise.",
}


class TerminalOperator:
    """Operator who confirms by Enter on standard input; without a terminal, nothing waits.

    ask: shows a line that a person has to read; say: the same line where nothing waits. pause: before all
    frames but the first, "key" for Enter or a number of seconds of `clock`. Darks and flats follow each other
    without one.
    """

    def __init__(
        self,
        ask: Callable[[str], None],
        pause: float | Literal["key"],
        clock: Clock,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._ask, self._say, self._pause, self._clock = ask, say, pause, clock
        self._kind: Subject = "scene"
        self._frame: int | None = None

    def show(self, kind: Subject) -> None:
        """Ask for what the cameras are to see, unless they do already."""
        if kind != self._kind:
            self._kind = kind
            self._wait(DO[kind])

    def move_to(self, frame: int) -> None:
        """Wait until rig and scene are ready for that frame."""
        moved, self._frame = self._frame not in (None, frame), frame
        if not moved or self._kind not in NEXT:
            return
        what = NEXT[self._kind].format(frame=frame)
        if self._pause == "key":
            self._wait(what)
        elif self._pause > 0:
            self._ask(f"{what} {self._pause:g} seconds from now it is shot.")
            self._clock.sleep(self._pause)

    def turn_to(self, band: str) -> None:
        """Wait until the wheel is at that filter; InputError without a terminal."""
        what = f"Filter {band}: turn the wheel of every camera to it."
        if self._pause != "key" and self._pause > 0:
            self._ask(f"{what} {self._pause:g} seconds from now it is shot.")
            self._clock.sleep(self._pause)
        elif sys.stdin is not None and sys.stdin.isatty():
            self._wait(what)
        else:
            raise InputError(
                f"the filter wheel cannot be turned to {band} here: capture in a terminal, or give "
                "RIG.toml a pause in seconds for turning it."
            )

    def _wait(self, what: str) -> None:
        if sys.stdin is not None and sys.stdin.isatty():
            self._ask(f"{what} Then press Enter.")
            with suppress(OSError):  # the terminal is gone
                sys.stdin.readline()
        else:
            self._say(what)
