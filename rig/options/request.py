"""Options of the command line that a request declares: their types, defaults and helps are the request's."""

import inspect
import types
import typing
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from enum import StrEnum
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from imaging.request import Request


@dataclass(frozen=True)
class Shown:
    """Presentation of an option on the command line, where its name, type and help do not say all.

    name: of the option. kind: its type as typed, from which `made` makes the value. more: a sentence that its
    help ends with. how: further settings of `typer.Option`.
    """

    name: str | None = None
    kind: Any = None
    made: Callable[[Any], object] = lambda value: value
    more: str = ""
    how: Mapping[str, Any] = field(default_factory=dict)


PLAIN = Shown()


class Asked:
    """Annotation of a command's parameter: a request, whose options are those of the command.

    beside: fields available from Python only. shown: presentation of the other fields, where the default does
    not do.
    """

    def __init__(self, beside: Collection[str] = (), **shown: Shown) -> None:
        self.beside, self.shown = beside, shown

    def parameters(self, request: type[Request]) -> Iterator[inspect.Parameter]:
        """Options as typer reads them."""
        for one in fields(request):
            if one.name in self.beside:
                continue
            kind, text = typing.get_args(one.type)[:2]
            shown = self.shown.get(one.name, PLAIN)
            name = shown.name or "--" + one.name.replace("_", "-")
            option = typer.Option(name, help=f"{text} {shown.more}".strip(), **shown.how)
            yield inspect.Parameter(
                one.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=None if one.default in ((), MISSING) else one.default,
                annotation=Annotated[_typed(kind) if shown.kind is None else shown.kind, option],
            )

    def request(self, request: type[Request], typed: dict[str, Any]) -> Request:
        """The request, of values as typed, which are taken out of `typed`; None: it was not typed."""
        values = {one.name: typed.pop(one.name) for one in fields(request) if one.name in typed}
        made = {
            name: self.shown.get(name, PLAIN).made(value)
            for name, value in values.items()
            if value is not None
        }
        return request(**made)


def _typed(kind: Any) -> Any:
    """The type of an option as typer has it: a path of text or a path, a list of a collection."""
    origin, held = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        if any(typing.get_origin(one) is PathLike for one in held):
            return Path | None
        return typing.Union[tuple(_typed(one) for one in held)]  # noqa: UP007
    if origin in (Collection, Sequence):
        if typing.get_origin(held[0]) is Literal:  # of which typer takes no list
            held = (StrEnum("Choice", {one: one for one in typing.get_args(held[0])}),)
        return list[held[0]]  # type: ignore[valid-type]
    return kind


def expanded(command: Callable[..., Any]) -> tuple[list[inspect.Parameter], Callable[..., Any]]:
    """The parameters of a command, options in place of its request, and the command that takes them."""
    parameters: list[inspect.Parameter] = []
    asked: list[tuple[str, type[Request], Asked]] = []
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        kind, *notes = typing.get_args(parameter.annotation) or (None,)
        note = next((one for one in notes if isinstance(one, Asked)), None)
        if note is None:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
        else:
            parameters += note.parameters(kind)
            asked.append((parameter.name, kind, note))

    def run(**typed: Any) -> Any:
        requests = {name: note.request(kind, typed) for name, kind, note in asked}
        return command(**typed, **requests)

    return parameters, run
