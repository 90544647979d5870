"""The USB and the network of this machine, or the bus of a simulated rig, and what a session is shot with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from capture import connected_rig, rig_of_nodes, simulated
from capture.record import source as sources
from capture.request import RigRequest
from capture.rigfile import network_address, rigfile
from drivers import clock as clocks
from drivers import usb
from drivers.sim import bus_rig, faults, rigs
from rig.terminal import operator
from rig.terminal.progress import StatusLine

if TYPE_CHECKING:
    from usb.backend import IBackend

    from drivers.gige import Network


@dataclass(frozen=True)
class UsbBus:
    """Bus of the drivers. rig: the simulated one; None on this machine's bus."""

    backend: IBackend
    clock: clocks.Clock
    rig: rigs.SimulatedRig | None = None


def open_bus(sim: str | None, seed: int = 0, *, rough: bool = False) -> UsbBus:
    """The bus of the simulated rig `sim`, or this machine's by default. InputError for an unknown rig."""
    if sim is None:
        return UsbBus(usb.default_backend(), clocks.SystemClock())

    rig = rigs.simulate(sim, seed)
    bus = bus_rig.BusRig(rig, mix=faults.ROUGH if rough else None)
    return UsbBus(bus.backend, bus.clock, rig)


def open_network(sim: str | None, addresses: Sequence[network_address.NetworkAddress] = ()) -> Network | None:
    """The network of this machine, with GigE Vision cameras at these addresses; none for a simulated rig."""
    if sim is not None:
        return None

    from drivers.gige import Network

    return Network(network_address.gige_hosts(addresses))


def _operator_for(bus: UsbBus, rig: rigfile.RigFile, status: StatusLine) -> sources.Operator:
    """Operator of the rig and of its targets: the simulator, or the person at the terminal."""
    if bus.rig is not None:
        return bus.rig
    return _person(rig, status, bus.clock)


def _person(rig: rigfile.RigFile, status: StatusLine, clock: clocks.Clock) -> sources.Operator:
    """Operator at the terminal."""
    return operator.TerminalOperator(status.ask, rig.tables.pause, clock, status.say)


@contextmanager
def source_of(
    sim: str | None,
    seed: int,
    rig: rigfile.RigFile | None,
    request: RigRequest,
    status: StatusLine,
    *,
    rough: bool = False,
) -> Iterator[sources.Source]:
    """Source named on the command line: the cameras of a rig file, or with `sim` simulated ones in their
    place.

    Args:
        sim: Name of a simulated rig; None: the cameras that are connected. Without a rig file it is needed.
        seed: Of the simulated rig.
        rig: Rig file; None: the simulated rig alone.
        request: Of the capture.
        status: Line of the terminal, where a person is asked, too.
        rough: True if the simulated cameras fail now and then, by `drivers.sim.faults.ROUGH`.

    Returns:
        A context manager that gives the source, and closes its cameras in the end.

    Raises:
        InputError: As of `connected_source`, `simulated_source` and `ray_source`.
        CaptureError: As of `connected_source` and `ray_source`.
    """
    if rig is None:
        assert sim is not None  # the command line was looked through
        with simulated.simulated_source(sim, seed, faults.ROUGH if rough else None) as source:
            yield source
        return
    if sim is None and rig.tables.nodes:
        clock = clocks.SystemClock()
        person = _person(rig, status, clock)
        status("joining the nodes", 0, 0)
        with rig_of_nodes.ray_source(
            rig, request, request.ray, person=person, clock=clock, say=status.say
        ) as source:
            status("planning", 0, 0)
            yield source
        return

    bus = open_bus(sim, seed, rough=rough)
    request = replace(
        request,
        operator=_operator_for(bus, rig, status),
        positions=bus.rig.frames if bus.rig else None,
        backend=bus.backend,
        clock=bus.clock,
        network=open_network(sim, rig.tables.addresses),
    )
    with connected_rig.connected_source(rig, request, say=status.say) as source:
        yield source
