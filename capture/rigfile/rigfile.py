"""`RIG.toml`: which cameras make the rig, and how it is shot where the command line does not say.

Every error names the line that it is about.
"""

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from capture.rigfile.filters import fault_of_bands, fault_of_wheels
from capture.rigfile.tables import RigTables
from capture.rigfile.toml_lines import Path as KeyPath
from capture.rigfile.toml_lines import key_lines, line_of
from imaging.arguments import checked
from imaging.errors import InputError


@dataclass(frozen=True)
class RigFile:
    """A rig file that is sound in itself, and where in it everything stands."""

    path: Path
    tables: RigTables
    lines: Mapping[KeyPath, int]

    def at(self, *keys: str | int) -> str:
        """`RIG.toml, line 12`: where a key stands, or the table around it."""
        return f"{self.path}, line {line_of(self.lines, keys)}"


@checked
def read_rig_file(path: str | Path) -> RigFile:
    """Read and validate a rig file.

    Args:
        path: TOML file.

    Returns:
        Cameras, triggering, brackets and bands of the rig.

    Raises:
        InputError: The file cannot be used; the sentence names the line at fault.
    """
    path = Path(path)
    text = _text(path)
    try:
        value = tomllib.loads(text)
        lines = key_lines(text)
    except RecursionError:
        raise InputError(f"{path} is nested too deeply: write it anew with rig init.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(_syntax(path, text, str(error))) from None
    try:
        tables = RigTables.model_validate(value)
    except ValidationError as error:
        # A key that is misspelt is also missing: its own error comes first. A table that is wrong is not
        # counted, and the cameras may seem too few.
        first = min(
            error.errors(),
            key=lambda error: (
                error["type"] != "extra_forbidden",
                error["type"] == "too_short",
                line_of(lines, error["loc"]),
            ),
        )
        raise InputError(_sentence(path, first, lines)) from None
    rig = RigFile(path, tables, lines)
    _must_be_one_rig(rig)
    return rig


def _text(path: Path) -> str:
    """The text of a file, without the mark that some editors put before it."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path} does not exist: create it with `rig init {path}`.") from None
    except IsADirectoryError:
        raise InputError(f"{path} is a folder: name the file that rig init wrote.") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path} cannot be read ({reason.lower()}): correct the path.") from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}, line {line}: this is not UTF-8 text; save the file as UTF-8.") from None


def _syntax(path: Path, text: str, message: str) -> str:
    """Return what is no TOML, with the line that `tomllib` names in its message."""
    position = re.fullmatch(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", message, re.DOTALL)
    what, line = (position[1], position[2]) if position else (message, None)
    number = int(line) if line else text.rstrip().count("\n") + 1
    return f"{path}, line {number}: this is not valid TOML ({what[:1].lower()}{what[1:]}); correct the line."


def _sentence(path: Path, error: ErrorDetails, lines: Mapping[KeyPath, int]) -> str:
    """One sentence for the first thing that is wrong."""
    keys, kind = error["loc"], error["type"]
    where = f"{path}, line {line_of(lines, keys)}"
    key = str(keys[-1])
    if kind == "extra_forbidden":
        allowed = _keys_of(keys[:-1])
        near = difflib.get_close_matches(key, allowed, 1)
        fix = f"did you mean {near[0]}?" if near else f"the keys here are {', '.join(allowed)}."
        return f"{where}: there is no key {key!r}; {fix}"
    if keys == ("camera",) and kind in ("missing", "too_short"):
        return f"{path} names no camera: add a [[camera]] with name and serial, or write it with rig init."
    if kind == "missing":
        return f"{where}: the {keys[0]} has no {key}; add it."
    if keys == ("board",) and kind == "value_error":
        return f"{where}: {error['msg'].removeprefix('Value error, ')}."
    limits = error.get("ctx", {})
    words = {
        "string_type": "text in quotes",
        "string_too_short": "text that is not empty",
        "float_type": "a number",
        "int_type": "a whole number",
        "tuple_type": "written with two brackets, as [[camera]]",
        "model_type": f"a table, as [{key}]",
        "greater_than": f"above {limits.get('gt')}",
        "greater_than_equal": f"{limits.get('ge')} or more",
        "less_than_equal": f"{limits.get('le')} or less",
        "literal_error": str(limits.get("expected")).replace("'", '"'),
    }
    what = words.get(kind, error["msg"].removeprefix("Value error, ").removeprefix("a name is "))
    return f"{where}: {key} has to be {what}."


def _keys_of(table: KeyPath) -> list[str]:
    """The keys that a table may have."""
    model: type[BaseModel] = RigTables
    for name in (name for name in table if isinstance(name, str)):
        kind = model.model_fields[name].annotation
        model = next(choice for choice in (kind, *get_args(kind)) if isinstance(choice, type))
    return list(model.model_fields)


def _must_be_one_rig(rig: RigFile) -> None:
    """Raise InputError where cameras are not distinct, or the trigger is not that of these cameras."""
    cameras, trigger = rig.tables.camera, rig.tables.trigger
    for key in ("name", "serial"):
        _must_differ(rig, key, [getattr(camera, key) for camera in cameras])
    bands = [camera.band for camera in cameras]
    for key, fault in (
        ("filters", fault_of_wheels([camera.filters for camera in cameras], bands)),
        ("band", fault_of_bands(bands)),
    ):
        if fault is not None:
            raise InputError(f"{rig.at('camera', fault[0], key)}: {fault[1]}")
    for index, camera in enumerate(cameras):
        if (camera.focal_length is None) != (camera.pixel_pitch is None):
            there, lacks = ("focal_length", "pixel_pitch")[:: 1 if camera.focal_length else -1]
            raise InputError(
                f"{rig.at('camera', index, there)}: {camera.name} has {there} and no {lacks}; add {lacks} "
                "(focal_length in mm, pixel_pitch in um), or leave both out."
            )
    subject = rig.tables.subject
    if subject is not None and not subject.nearest <= subject.farthest:
        raise InputError(
            f"{rig.at('subject', 'farthest')}: farthest ({subject.farthest:g} m) is less than nearest "
            f"({subject.nearest:g} m); exchange them."
        )
    if trigger.leader is not None and trigger.leader not in {camera.name for camera in cameras}:
        raise InputError(
            f"{rig.at('trigger', 'leader')}: there is no camera {trigger.leader!r}; "
            f"the cameras are {', '.join(camera.name for camera in cameras)}."
        )
    if rig.tables.nodes:
        _must_have_nodes(rig)
    if trigger.mode == "hardware" and trigger.line is None:
        raise InputError(
            f"{rig.at('trigger', 'mode')}: a hardware trigger comes in on a line; "
            'add line, as line = "Line0".'
        )


def _must_have_nodes(rig: RigFile) -> None:
    """InputError where only some cameras name a node, or one command is to reach all over the network."""
    first = rig.tables.nodes[0]
    for index, camera in enumerate(rig.tables.camera):
        if camera.node is None:
            raise InputError(
                f"{rig.at('camera', index)}: {camera.name} names no node, as other cameras do; add node, as "
                f'node = "{first}" (the host that leads serves its own cameras by a rig node, too).'
            )
    if rig.tables.trigger.mode == "action":
        raise InputError(
            f"{rig.at('trigger', 'mode')}: action commands trigger cameras of one host; with nodes set mode "
            '= "software", which releases all at one moment of compared clocks, or "hardware".'
        )


def _must_differ(rig: RigFile, key: str, values: Iterable[str]) -> None:
    first: dict[str, int] = {}
    for index, value in enumerate(values):
        folded = value.casefold() if key == "name" else value  # some disks do not distinguish A from a
        if folded in first:
            before = line_of(rig.lines, ("camera", first[folded], key))
            raise InputError(
                f"{rig.at('camera', index, key)}: line {before} has the {key} {value!r} already; "
                f"give every camera its own."
            )
        first[folded] = index
