"""Argument checks of public functions: a value of a wrong type gives one sentence before any work begins."""

import functools
import inspect
import numbers
import sys
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

from imaging.errors import InputError
from imaging.request import Request

P = ParamSpec("P")
R = TypeVar("R")
_NUMBERS: dict[Any, type] = {float: numbers.Real, int: numbers.Integral}
_WORDS = {
    str: "text",
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    PathLike: "a path",
    types.NoneType: "None",
}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function refuse arguments that are of none of the types in its signature.

    A stage, whose signature has a `request` and `**options`, is given one request: options by name are in
    place of its values, and each of them is checked; types that it quotes are of its module or of the
    function's. Types that a signature quotes, protocols that cannot be checked, and what collections hold are
    left to the function. Errors: InputError.
    """
    signature = inspect.signature(function)
    asked = signature.parameters.get("request")

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        bound = signature.bind(*args, **kwargs)
        given = bound.arguments
        if asked is not None:
            request = type(asked.default).of(given.get("request"), given.pop("options", {}))
            given["request"] = request
            for name, kind in _types_of(request, function):
                check(name, getattr(request, name), kind)
        for name, value in given.items():
            check(name, value, signature.parameters[name].annotation)
        return function(*bound.args, **bound.kwargs)

    def check(name: str, value: object, kind: Any) -> None:
        if not fits(value, kind):
            raise InputError(
                f"{function.__name__} cannot take {value!r:.60} for {name}: give it {wanted(kind)}."
            )

    return call


def _types_of(request: Request, function: Callable[..., object]) -> Iterator[tuple[str, Any]]:
    known = inspect.unwrap(function).__globals__ | vars(sys.modules[type(request).__module__])
    for option in fields(request):
        with suppress(NameError):  # a type that the request quotes, and that no module here has
            yield option.name, _resolved(typing.get_args(option.type)[0], known)


def _resolved(kind: Any, known: dict[str, Any]) -> Any:
    return eval(kind.__forward_arg__, known) if isinstance(kind, typing.ForwardRef) else kind


def fits(value: object, kind: Any) -> bool:
    """Return whether a value fits the type of an annotation, as far as that can be checked."""
    origin = typing.get_origin(kind)
    if origin in (types.UnionType, typing.Union):
        return any(fits(value, one) for one in typing.get_args(kind))
    if origin is Literal:
        return isinstance(value, str | int) and value in typing.get_args(kind)
    if kind is None:
        return value is None
    if kind is inspect.Parameter.empty:
        return True
    if origin is Sequence:
        return isinstance(value, Iterable) and not isinstance(value, str | bytes | Mapping)
    if kind in _NUMBERS:
        return isinstance(value, _NUMBERS[kind]) and not isinstance(value, bool)
    kind = PathLike if kind is Path else origin or kind
    if getattr(kind, "_is_protocol", False) and not getattr(kind, "_is_runtime_protocol", False):
        return True
    return not isinstance(kind, type) or isinstance(value, kind)


def wanted(kind: Any) -> str:
    """An annotation in words."""
    origin = typing.get_origin(kind)
    if origin in (types.UnionType, typing.Union):
        return " or ".join(dict.fromkeys(wanted(one) for one in typing.get_args(kind)))
    if origin is Literal:
        return "one of " + ", ".join(repr(one) for one in typing.get_args(kind))
    if origin is Sequence:
        (held,) = typing.get_args(kind)
        return f"a list or tuple, each of it {wanted(held)}"
    kind = PathLike if kind is Path else origin or kind
    return _WORDS.get(kind) or f"a {getattr(kind, '__name__', kind)}"
