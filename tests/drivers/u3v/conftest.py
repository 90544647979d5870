"""A simulated USB3 Vision camera on a virtual bus."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import Fault, FaultPlan
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from drivers.u3v import U3vCamera
from imaging.sensor.cfa import Cfa


@dataclass
class Bench:
    """Connected devices, and a second camera that shoots the same without any USB."""

    clock: VirtualClock
    bus: VirtualBus
    device: U3vDevice
    plan: FaultPlan
    twin: SimulatedCamera

    @property
    def serial(self) -> str:
        return self.twin.body.serial

    def camera(self, line: str | None = None) -> U3vCamera:
        camera = U3vCamera(self.serial, self.bus, self.clock)
        if line is not None:
            camera.listen(line)
        return camera


MakeBench = Callable[..., Bench]


@pytest.fixture(scope="session")
def make_bench() -> MakeBench:
    rigs = {bits: simulate("toy", bit_depth=bits, seed=5) for bits in (12, 14)}
    views = {bits: np.asarray(rig.radiance(0, 0)) for bits, rig in rigs.items()}

    def make(bits: int = 12, cfa: Cfa = Cfa.RGGB, faults: Sequence[Fault] = ()) -> Bench:
        body = replace(rigs[bits].bodies[0], cfa=cfa)
        clock = VirtualClock()
        bus = VirtualBus(clock)
        plan = FaultPlan(clock, faults)
        device = U3vDevice(SimulatedCamera(body, lambda frame: views[bits]), clock, plan)
        bus.plug(device)
        return Bench(clock, bus, device, plan, SimulatedCamera(body, lambda frame: views[bits]))

    return make
