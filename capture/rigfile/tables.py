"""The tables of `RIG.toml`, and how their values are written."""

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from capture.bracket.goals import BracketGoals
from capture.check.check import SKEW_TOLERANCE
from capture.rigfile.filters import band_of, wheel_of
from capture.rigfile.network_address import NetworkAddress, address_of
from capture.rigfile.shutter_time import seconds_of
from imaging.optics.exposure import Exposure
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
    """Camera: `serial` is its identity, `name` its place in file names.

    rig: cameras that name the same rig keep their places to each other; None: no rig. position: in
    the rig, m, in any axes; with those of two cameras the scene has a scale. band: the filter before a mono
    camera; filters: those of the wheel before it, in the order of shooting. address: of a PTP/IP camera, or a
    GigE Vision camera that no broadcast reaches. node: the host that it is connected to; None: the one that
    captures. focal_length: mm, and pixel_pitch: distance between photosites, um: for the plan
    of focus and views, and for the calibration where files state no focal length.
    """

    name: Annotated[Name, Field(strict=True)]
    serial: Text
    rig: Text | None = None
    position: Annotated[tuple[float, float, float], BeforeValidator(_place)] | None = None
    band: Annotated[Band, BeforeValidator(band_of)] | None = None
    filters: Annotated[tuple[Band, ...], BeforeValidator(wheel_of)] = ()
    address: Annotated[NetworkAddress, BeforeValidator(address_of)] | None = None
    node: Annotated[Name, Field(strict=True)] | None = None
    focal_length: Positive | None = None
    pixel_pitch: Positive | None = None


class SubjectTable(_Table):
    """Subject: distances from the cameras to its nearest and its farthest that are to be sharp, m."""

    nearest: Positive
    farthest: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=True)] = math.inf


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
        """Goals for the planner."""
        return BracketGoals(self.snr, self.slowest, self.total, self.highest_iso)

    def middle(self, lowest_iso: float | None) -> Exposure | None:
        """The middle exposure, if the file gives its time."""
        if self.time is None:
            return None
        iso = lowest_iso if self.iso is None else self.iso
        return Exposure(time=self.time, f_number=self.f_number, iso=iso)


class TriggerTable(_Table):
    """Common triggering of the cameras.

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
    """Tables of the whole file. pause: before every frame but the first, for Enter or that many seconds."""

    frames: Annotated[int, Field(strict=True, ge=1, le=9999)] = 1
    pause: Annotated[float | Literal["key"], BeforeValidator(_pause)] = "key"
    bracket: BracketTable = BracketTable()
    trigger: TriggerTable = TriggerTable()
    board: Board | None = None
    subject: SubjectTable | None = None
    camera: Annotated[tuple[CameraTable, ...], Field(min_length=1)]

    @property
    def leader(self) -> str | None:
        """The camera whose exposure, or whose command, makes the others expose."""
        if self.trigger.mode == "action":
            return self.trigger.leader or self.camera[0].name
        return self.trigger.leader if self.trigger.mode == "hardware" else None

    @property
    def addresses(self) -> tuple[NetworkAddress, ...]:
        """Addresses of cameras that discovery cannot find."""
        return tuple(camera.address for camera in self.camera if camera.address is not None)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Hosts that its cameras are connected to, each once; empty: all are connected to this one."""
        return tuple(dict.fromkeys(camera.node for camera in self.camera if camera.node is not None))

    @property
    def bands(self) -> tuple[Band, ...]:
        """The filters before the cameras, each once, by wavelength; none if these have none."""
        fixed = {camera.band.name: camera.band for camera in self.camera if camera.band}
        return in_order([*fixed.values(), *self.wheel])

    @property
    def wheel(self) -> tuple[Band, ...]:
        """Filters that every camera has one after another; empty if these stay, or there are no filters."""
        return self.camera[0].filters
