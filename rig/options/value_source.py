"""Sources of the values of options: what was typed has to go together, and the user's defaults yield."""

from dataclasses import MISSING, fields, replace
from typing import TypeVar

import typer

from imaging.request import Request

R = TypeVar("R", bound=Request)


def is_typed(context: typer.Context, name: str) -> bool:
    """Return whether the value of a parameter is from the command line or the environment."""
    return _source(context, name) in ("COMMANDLINE", "ENVIRONMENT")


def is_users(context: typer.Context, name: str) -> bool:
    """Return whether the value of a parameter is from the user's file of defaults."""
    return _source(context, name) == "DEFAULT_MAP"


def without_users(context: typer.Context, request: R, *names: str) -> R:
    """Return the request with its class's defaults in place of the user's for options of these names."""
    defaults = {one.name: one.default for one in fields(request) if one.default is not MISSING}
    return replace(request, **{name: defaults[name] for name in names if is_users(context, name)})


def _source(context: typer.Context, name: str) -> str:
    source = context.get_parameter_source(name)
    return "DEFAULT" if source is None else source.name
