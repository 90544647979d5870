"""Requests: what is asked of a stage, one frozen record, each option with its type, its default and its help.

A stage is `stage(subject, Request) -> Record`. The help of an option is the text in its `Annotated` type: the
command line shows it, and so does the reference. None keeps what an earlier run was given, or leaves the
choice to the stage; FORGET drops what an earlier run was given; anything else is a value.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from os import PathLike, fspath
from typing import Any, Final, Literal, Self

from imaging.errors import InputError

Forget = Literal["none"]
FORGET: Final = "none"


@dataclass(frozen=True)
class Request:
    """Base of all requests."""

    @classmethod
    def of(cls, given: object, options: Mapping[str, object]) -> Self:
        """A request from keywords; those beside one that is given, or beside the value of its first option,
        are in place of its values.

        InputError for one that is no option.
        """
        names = [field.name for field in fields(cls)]
        if unknown := sorted(options.keys() - set(names)):
            raise InputError(f"There is no option {unknown[0]!r}: give any of {', '.join(names)}.")
        values: Any = options
        if isinstance(given, cls):
            return replace(given, **values)
        return cls(**({} if given is None else {names[0]: given}) | values)


def forgets(value: str | PathLike[str] | None) -> bool:
    """Return whether an option asks to forget what an earlier run was given."""
    return value is not None and fspath(value) == FORGET


def value_of(given: str | PathLike[str] | None) -> str | PathLike[str] | None:
    """A value that was given; None where an option keeps or forgets."""
    return None if forgets(given) else given
