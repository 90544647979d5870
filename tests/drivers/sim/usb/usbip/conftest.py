"""Servers of simulated devices on loopback, in the machine's own time."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass

import numpy as np
import pytest

from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import Fault, FaultPlan
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.port import Device
from drivers.sim.usb.timeline import LiveTimeline
from drivers.sim.usb.usbip.server import UsbIpServer, listen


@dataclass
class Served:
    """A bus and its server."""

    bus: VirtualBus
    server: UsbIpServer

    @property
    def address(self) -> tuple[str, int]:
        return self.server.host, self.server.port


@pytest.fixture
def serve() -> Iterator[Callable[..., Served]]:
    """Serve devices that are made for the timeline of their bus."""
    with ExitStack() as stack:

        def serving(*makers: Callable[[LiveTimeline], Device]) -> Served:
            timeline = stack.enter_context(closing(LiveTimeline()))
            bus = VirtualBus(timeline)
            for make in makers:
                bus.plug(make(timeline))
            return Served(bus, stack.enter_context(UsbIpServer(bus, listen(port=0))))

        yield serving


@dataclass
class Toy:
    """The first camera of a rig: as devices, and a twin that shoots the same without any USB."""

    twin: SimulatedCamera
    make: Callable[[], SimulatedCamera]

    def vision(self, *faults: Fault) -> Callable[[LiveTimeline], Device]:
        return lambda timeline: U3vDevice(self.make(), timeline, FaultPlan(timeline, faults))

    def still(self, name: str = "generic") -> Callable[[LiveTimeline], Device]:
        return lambda timeline: PtpDevice(Responder(self.make(), profile(name), timeline))


@pytest.fixture(scope="session")
def toy() -> Toy:
    rig = simulate("toy", seed=5)
    view = np.asarray(rig.radiance(0, 0))

    def make() -> SimulatedCamera:
        return SimulatedCamera(rig.bodies[0], lambda frame: view)

    return Toy(make(), make)
