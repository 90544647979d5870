"""`RIG.toml`: which cameras make the rig, and how it is shot where the command line does not say.

Every error names the line that it is about.
"""

import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from capture.bracket.planner import BracketGoals
from capture.check.check import SKEW_TOLERANCE
from capture.rigfile.filters import band_of, fault_of_bands, fault_of_wheels, wheel_of
from capture.rigfile.network_address import NetworkAddress, address_of
from capture.rigfile.shutter_time import seconds_of
from capture.rigfile.toml_lines import Path as KeyPath
from capture.rigfile.toml_lines import key_lines, line_of
from imaging.errors import InputError
from imaging.exposure import Exposure
from imaging.session.bands import in_order
from imaging.session.records import Band, Board, Name


def _time(value: Any) -> float:
    try:
        return seconds_of(value if isinstance(value, str) else f"{_number(value):.17f}")
    except (ValueError, OverflowError):
        raise ValueError('a shutter time as "1/30", or in seconds') from None


def _pause(value: Any) -> float | Literal["key"]:
    if value == "key":
        return "key"
    try:
        seconds = _number(value)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds <= 86_400:
        raise ValueError('"key", or seconds from 0 to 86400')
    return seconds


def _stops(value: Any) -> tuple[float, ...] | Literal["auto"]:
    if value == "auto":
        return "auto"
    try:
        stops = tuple(_number(stop) for stop in value) if isinstance(value, list) else ()
    except ValueError:
        stops = ()
    if not stops or not all(abs(stop) <= 30 for stop in stops):
        raise ValueError('"auto", or stops around the middle exposure as [-4, -2, 0, 2, 4]')
    if len(set(stops)) < len(stops):
        raise ValueError("made of stops that all differ")
    return tuple(sorted(stops))


def _place(value: Any) -> tuple[float, ...]:
    try:
        place = tuple(_number(coordinate) for coordinate in value) if isinstance(value, list) else ()
    except ValueError:
        place = ()
    if len(place) != 3:
        raise ValueError("three numbers, metres, as [0.2, 0.0, 0.0]")
    return place


def _number(value: Any) -> float:
    """ValueError for all but finite numbers, true and false included."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError
    return float(value)


Seconds = Annotated[float, BeforeValidator(_time)]
Text = Annotated[str, Field(strict=True, min_length=1)]
Positive = Annotated[float, Field(strict=True, gt=0)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class CameraTable(_Table):
    """A camera: `serial` is its identity, `name` its place in file names.

    rig: cameras that name the same rig keep their places to each other; None: it stands alone. position: in
    the rig, m, in any axes; with those of two cameras the scene has a scale. band: the filter before a mono
    camera; filters: those of the wheel before it, in the order of shooting. address: of a PTP/IP camera, or a
    GigE Vision camera that no broadcast reaches. node: the host that it is connected to; None: the one that
    captures.
    """

    name: Annotated[Name, Field(strict=True)]
    serial: Text
    rig: Text | None = None
    position: Annotated[tuple[float, float, float], BeforeValidator(_place)] | None = None
    band: Annotated[Band, BeforeValidator(band_of)] | None = None
    filters: Annotated[tuple[Band, ...], BeforeValidator(wheel_of)] = ()
    address: Annotated[NetworkAddress, BeforeValidator(address_of)] | None = None
    node: Annotated[Name, Field(strict=True)] | None = None


class BracketTable(_Table):
    """The bracket of the scene: planned, or stops around a middle exposure.

    time: of the middle exposure, metered if not given; f_number: of all exposures; iso: of stops. The rest
    is what a planned bracket has to reach and may not exceed.
    """

    exposures: Annotated[tuple[float, ...] | Literal["auto"], BeforeValidator(_stops)] = "auto"
    time: Seconds | None = None
    f_number: Positive | None = None
    iso: Positive | None = None
    snr: Annotated[float, Field(strict=True, ge=0, le=60)] = BracketGoals.snr
    slowest: Seconds | None = None
    total: Seconds | None = None
    highest_iso: Positive | None = None

    @property
    def wanted(self) -> BracketGoals:
        """What the planner is to reach."""
        return BracketGoals(self.snr, self.slowest, self.total, self.highest_iso)

    def middle(self, lowest_iso: float | None) -> Exposure | None:
        """The middle exposure, if the file gives its time."""
        if self.time is None:
            return None
        iso = lowest_iso if self.iso is None else self.iso
        return Exposure(time=self.time, f_number=self.f_number, iso=iso)


class TriggerTable(_Table):
    """How the cameras are made to expose together.

    hardware: all but the leader expose on a rising edge of their input `line`; the leader is triggered by
    software and shows on its line `output` (`line` if not given) that it exposes. Without a leader the
    edges come from elsewhere. action: all expose on a command over the network, which the leader, the first
    camera if none is named, sends when it is triggered. tolerance: s between the shutters of one step.
    """

    mode: Literal["software", "hardware", "action"] = "software"
    leader: Text | None = None
    line: Text | None = None
    output: Text | None = None
    tolerance: Positive = SKEW_TOLERANCE


class RigTables(_Table):
    """The whole file. pause: before every frame but the first, for Enter or so many seconds."""

    frames: Annotated[int, Field(strict=True, ge=1, le=9999)] = 1
    pause: Annotated[float | Literal["key"], BeforeValidator(_pause)] = "key"
    bracket: BracketTable = BracketTable()
    trigger: TriggerTable = TriggerTable()
    board: Board | None = None
    camera: Annotated[tuple[CameraTable, ...], Field(min_length=1)]

    @property
    def leader(self) -> str | None:
        """The camera whose exposure, or whose command, makes the others expose."""
        if self.trigger.mode == "action":
            return self.trigger.leader or self.camera[0].name
        return self.trigger.leader if self.trigger.mode == "hardware" else None

    @property
    def addresses(self) -> tuple[NetworkAddress, ...]:
        """Where cameras are asked by name."""
        return tuple(camera.address for camera in self.camera if camera.address is not None)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The hosts that its cameras are connected to, each once; none: all are connected to this one."""
        return tuple(dict.fromkeys(camera.node for camera in self.camera if camera.node is not None))

    @property
    def bands(self) -> tuple[Band, ...]:
        """The filters before the cameras, each once, by wavelength; none if these have none."""
        kept = {camera.band.name: camera.band for camera in self.camera if camera.band}
        return in_order([*kept.values(), *self.wheel])

    @property
    def wheel(self) -> tuple[Band, ...]:
        """The filters that every camera has one after another; none if these stay, or there are none."""
        return self.camera[0].filters


@dataclass(frozen=True)
class RigFile:
    """A rig file that is sound in itself, and where in it everything stands."""

    path: Path
    tables: RigTables
    lines: Mapping[KeyPath, int]

    def at(self, *keys: str | int) -> str:
        """`RIG.toml, line 12`: where a key stands, or the table around it."""
        return f"{self.path}, line {line_of(self.lines, keys)}"


def read_rig_file(path: str | Path) -> RigFile:
    """Read and validate a rig file; InputError of one sentence with the line that is at fault."""
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
        raise InputError(f"{path} is not there: write it with `rig init {path}`.") from None
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
    """What is no TOML, with the line that `tomllib` names in its message."""
    position = re.fullmatch(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", message, re.DOTALL)
    what, line = (position[1], position[2]) if position else (message, None)
    number = int(line) if line else text.rstrip().count("\n") + 1
    return f"{path}, line {number}: this is no TOML ({what[:1].lower()}{what[1:]}); correct the line."


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
    """InputError where cameras cannot be told apart, or the trigger is not that of these cameras."""
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
        folded = value.casefold() if key == "name" else value  # some disks do not tell A from a
        if folded in first:
            before = line_of(rig.lines, ("camera", first[folded], key))
            raise InputError(
                f"{rig.at('camera', index, key)}: line {before} has the {key} {value!r} already; "
                f"give every camera its own."
            )
        first[folded] = index
