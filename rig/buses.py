"""Where cameras are: on this machine's USB, or on that of a simulated rig."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from capture.record.source import Operator
    from capture.rigfile.rigfile import RigFile
    from drivers.clock import Clock
    from drivers.sim.rigs import SimulatedRig
    from rig.terminal.progress import Meter


@dataclass(frozen=True)
class Bus:
    """What drivers are given. rig: of a simulated bus."""

    backend: Any
    clock: Clock
    rig: SimulatedRig | None = None


def bus_of(sim: str | None, seed: int = 0, *, rough: bool = False) -> Bus:
    """The bus of the simulated rig `sim`, or this machine's if that is None. InputError: no such rig."""
    if sim is None:
        from drivers.clock import SystemClock
        from drivers.usb import default_backend

        return Bus(default_backend(), SystemClock())
    from drivers.sim.bus_rig import BusRig
    from drivers.sim.faults import ROUGH
    from drivers.sim.rigs import simulate

    rig = simulate(sim, seed)
    bus = BusRig(rig, mix=ROUGH if rough else None)
    return Bus(bus.backend, bus.clock, rig)


def operator_at(bus: Bus, rig: RigFile, meter: Meter) -> Operator:
    """Who moves things before the cameras: the simulator, or whoever gave the command."""
    if bus.rig is not None:
        return bus.rig
    from rig.terminal.operator import TerminalOperator

    return TerminalOperator(meter.say, rig.tables.pause, bus.clock)
