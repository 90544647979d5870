"""Settings of a node: its name, its cameras, and the folder of their frames."""

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError
from usb.backend import IBackend

from capture.nodes.request import NodeRequest
from capture.rigfile.network_address import NetworkAddress
from drivers.clock import Clock, SystemClock
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import ROUGH
from drivers.sim.jumping_clock import JumpingClock
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.timeline import LiveTimeline
from drivers.usb import default_backend
from imaging.errors import InputError
from imaging.record import Record
from imaging.session.records import Name

VARIABLE = "RIG_NODE"
"""The environment variable that holds the settings of a node, for the processes that Ray starts there."""

_DEFAULTS = NodeRequest()


class NodeSettings(Record):
    """Command-line settings of `rig node`.

    sim: the simulated rig whose cameras stand in for those of the USB, as the devices `profile`; rough: with
    faults; changes: of the rig's settings; jumps: of the clock of its drivers, as `JumpingClock` has them.
    """

    name: Name
    disk: Path
    addresses: tuple[NetworkAddress, ...] = ()
    sim: str | None = None
    profile: str = _DEFAULTS.profile
    seed: int = _DEFAULTS.seed
    rough: bool = _DEFAULTS.rough
    changes: Mapping[str, Any] = Field(default_factory=dict)
    jumps: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class Place:
    """Environment of a node's drivers, and a folder. rig: the simulated one; None: cameras are real.

    addresses: addresses of cameras that discovery cannot find, whatever the rig file says.
    """

    name: str
    backend: IBackend | None
    clock: Clock
    disk: Path
    addresses: tuple[NetworkAddress, ...] = ()
    rig: SimulatedRig | None = None


def place_of(settings: NodeSettings) -> Place:
    """The place of a node; a simulated one runs on the machine's own time. InputError: no such rig."""
    name, disk, addresses = settings.name, settings.disk, settings.addresses
    if settings.sim is None:
        return Place(name, default_backend(), SystemClock(), disk, addresses)
    rig = simulate(settings.sim, settings.seed, **settings.changes)
    mix = ROUGH if settings.rough else None
    bus = BusRig(rig, mix=mix, model=settings.profile, clock=LiveTimeline())
    clock = JumpingClock(bus.clock, jumps=settings.jumps) if settings.jumps else bus.clock
    return Place(name, bus.backend, clock, disk, addresses, rig)


def settings_of(**given: Any) -> NodeSettings:
    """Read settings from the command line. InputError for a value that cannot be used."""
    try:
        return NodeSettings(**given)
    except ValidationError as error:
        what = error.errors()[0]
        raise InputError(
            f"{'.'.join(map(str, what['loc']))} {what['input']!r} cannot be used: "
            f"{what['msg'].removeprefix('Value error, ').lower()}."
        ) from None


def settings_here() -> NodeSettings:
    """Settings of the node that this process runs on. InputError outside a node."""
    with suppress(KeyError, ValidationError):
        return NodeSettings.model_validate_json(os.environ[VARIABLE])
    raise InputError("this host is not a node of a rig: start one with rig node.")
