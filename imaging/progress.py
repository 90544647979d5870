"""Progress callbacks of a stage."""

from collections.abc import Callable

Progress = Callable[[str, int, int], None]
"""Called with what is being done, the steps that are done, and all of them; 0 of 0 where their number is
not known."""


def unreported(message: str, done: int, total: int) -> None:
    """Discard progress."""
