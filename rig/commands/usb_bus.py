"""The USB and the network of this machine, or the bus of a simulated rig, and what a session is shot with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from usb.backend import IBackend

    from capture.record.source import CaptureRequest, Operator, Source
    from capture.rigfile.network_address import NetworkAddress
    from capture.rigfile.rigfile import RigFile
    from drivers.clock import Clock
    from drivers.gige import Network
    from drivers.sim.rigs import SimulatedRig
    from rig.terminal.progress import StatusLine


@dataclass(frozen=True)
class UsbBus:
    """Bus of the drivers. rig: the simulated one; None on this machine's bus."""

    backend: IBackend
    clock: Clock
    rig: SimulatedRig | None = None


def open_bus(sim: str | None, seed: int = 0, *, rough: bool = False) -> UsbBus:
    """The bus of the simulated rig `sim`, or this machine's by default. InputError for an unknown rig."""
    if sim is None:
        from drivers.clock import SystemClock
        from drivers.usb import default_backend

        return UsbBus(default_backend(), SystemClock())
    from drivers.sim.bus_rig import BusRig
    from drivers.sim.faults import ROUGH
    from drivers.sim.rigs import simulate

    rig = simulate(sim, seed)
    bus = BusRig(rig, mix=ROUGH if rough else None)
    return UsbBus(bus.backend, bus.clock, rig)


def open_network(sim: str | None, addresses: Sequence[NetworkAddress] = ()) -> Network | None:
    """The network of this machine, with GigE Vision cameras at these addresses; none for a simulated rig."""
    if sim is not None:
        return None
    from capture.rigfile.network_address import gige_hosts
    from drivers.gige import Network

    return Network(gige_hosts(addresses))


def _operator_for(bus: UsbBus, rig: RigFile, status: StatusLine) -> Operator:
    """Operator of the rig and of its targets: the simulator, or the person at the terminal."""
    if bus.rig is not None:
        return bus.rig
    return _person(rig, status, bus.clock)


def _person(rig: RigFile, status: StatusLine, clock: Clock) -> Operator:
    """Operator at the terminal."""
    from rig.terminal.operator import TerminalOperator

    return TerminalOperator(status.ask, rig.tables.pause, clock, status.say)


@contextmanager
def source_of(
    sim: str | None,
    seed: int,
    rig: RigFile | None,
    request: CaptureRequest,
    status: StatusLine,
    *,
    rough: bool = False,
    ray: str = "auto",
) -> Iterator[Source]:
    """Source named on the command line: the cameras of a rig file, or with `sim` simulated ones in their
    place.

    ray: the cluster of the nodes that a rig file names. InputError and CaptureError as `connected_source`,
    `simulated_source` and `ray_source` have them.
    """
    if rig is None:
        from capture.simulated import simulated_source
        from drivers.sim.faults import ROUGH

        assert sim is not None  # the command line was looked through
        with simulated_source(sim, seed, ROUGH if rough else None) as source:
            yield source
        return
    if sim is None and rig.tables.nodes:
        from capture.rig_of_nodes import ray_source
        from drivers.clock import SystemClock

        clock = SystemClock()
        person = _person(rig, status, clock)
        status("joining the nodes", 0, 0)
        with ray_source(rig, request, ray, person=person, clock=clock, say=status.say) as source:
            status("planning", 0, 0)
            yield source
        return
    from capture.connected_rig import connected_source

    bus = open_bus(sim, seed, rough=rough)
    with connected_source(
        rig,
        request,
        operator=_operator_for(bus, rig, status),
        positions=bus.rig.frames if bus.rig else None,
        backend=bus.backend,
        clock=bus.clock,
        network=open_network(sim, rig.tables.addresses),
        say=status.say,
    ) as source:
        yield source
