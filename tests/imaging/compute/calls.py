"""Functions that processes call, each of which imports this module: with it they load no library."""

import os
import signal
from pathlib import Path

from imaging.errors import InputError


def half(number: int) -> tuple[int, int]:
    """Half of an even number, and who found it."""
    if number % 2:
        raise InputError(f"{number} is odd: name an even number.")
    print("this is no answer")
    return number // 2, os.getpid()


def killed_there(number: int, here: int) -> int:
    """Twice the number, unless another process than `here` is asked."""
    if os.getpid() != here:
        os.kill(os.getpid(), signal.SIGTERM)
    return 2 * number


def marked(folder: Path, number: int) -> int:
    """Leave a file in the folder."""
    (folder / str(number)).touch()
    return number


class KeptError(Exception):
    """Error that holds what cannot be pickled."""

    def __init__(self, number: int) -> None:
        super().__init__(f"{number} is odd", lambda: number)


class NamedError(Exception):
    """Error whose arguments are not those that its class takes."""

    def __init__(self, number: int, *, what: str) -> None:
        super().__init__(f"{number} is {what}")


def raising(kind: str, number: int) -> None:
    """Raise an error of a kind that no pipe carries."""
    raise KeptError(number) if kind == "kept" else NamedError(number, what="odd")


def unsendable(number: int) -> object:
    """Function that cannot be pickled."""
    return lambda: number
