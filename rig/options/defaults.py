"""Defaults of the user's own: a TOML file with a table for each command, its keys the command's options."""

import os
import tomllib
from collections.abc import Iterable
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import typer

from imaging.errors import InputError
from imaging.request import Request

R = TypeVar("R", bound=Request)

NAMED_BY = "RIG_CONFIG"
"""Environment variable with the file to read instead; empty: none."""


def config_file() -> Path | None:
    """Active file: the one in RIG_CONFIG, else ~/.config/rig/config.toml if it exists, else None."""
    named = os.environ.get(NAMED_BY)
    if named is not None:
        return Path(named).expanduser() if named else None
    path = usual_place()
    return path if path.is_file() else None


def usual_place() -> Path:
    """Default place of the file: by freedesktop.org's specification of base directories."""
    base = os.environ.get("XDG_CONFIG_HOME", "")
    home = Path(base) if os.path.isabs(base) else Path("~/.config").expanduser()
    return home / "rig" / "config.toml"


def read_defaults(path: Path, group: Any, name: str = "") -> dict[str, dict[str, Any]]:
    """Values by command and parameter, as they would be typed, of the commands of a typer `group`.

    Those of the command called `name` are tried, or if that is empty those of all. InputError of one sentence
    for a file that cannot be read, a command or an option that does not exist, a switch, or a value that
    cannot be.
    """
    return {
        command: _of_command(table, f"{path}: [{command}]", group.commands[command], name in ("", command))
        for command, table in _tables(path, group.commands).items()
    }


def _tables(path: Path, commands: Iterable[str]) -> dict[str, dict[str, Any]]:
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path} cannot be read ({reason}): correct the file or {NAMED_BY}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not valid TOML ({error}): correct it.") from error
    for command, table in tables.items():
        if command not in commands:
            raise InputError(f"{path}: there is no command {command!r}: name one of {', '.join(commands)}.")
        if not isinstance(table, dict):
            raise InputError(f"{path}: {command} is not a table: write [{command}], and its options below.")
    return tables


def _of_command(table: dict[str, Any], where: str, command: Any, tried: bool) -> dict[str, Any]:
    """Values by parameter. Switches are left to the command line: nothing could switch them off again."""
    options = {
        option.removeprefix("--"): parameter
        for parameter in command.params
        for option in parameter.opts
        if option.startswith("--") and not parameter.is_flag
    }
    values = {}
    for key, value in table.items():
        if key not in options:
            has = f"set one of {', '.join(options)}" if options else "nothing can be set for it"
            raise InputError(f"{where} has no {key!r} that takes a value: {has}.")
        parameter = options[key]
        typed = [_typed(item, f"{where} {key}") for item in (value if isinstance(value, list) else [value])]
        if not parameter.multiple and isinstance(value, list):
            raise InputError(f"{where} {key} takes one value: write it without brackets.")
        values[parameter.name] = typed if parameter.multiple else typed[0]
        if tried:
            try:
                parameter.process_value(typer.Context(command), values[parameter.name])
            except typer.BadParameter as error:
                message = error.message.replace("Value error, ", "").strip().rstrip(".")
                raise InputError(f"{where} {key}: {message}.") from error
    return values


def _typed(value: object, where: str) -> str:
    """A value as it would be typed."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError(f"{where} is neither text nor a number: write it as on the command line, in quotes.")
    return str(value)


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
