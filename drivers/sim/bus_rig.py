"""A simulated rig on a virtual USB bus, driven by the very drivers that drive hardware."""

from collections.abc import Sequence

from drivers import ptp, u3v
from drivers.camera import Camera
from drivers.sim.faults import Fault, FaultPlan, Mix
from drivers.sim.ptp.profiles import profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig
from drivers.sim.u3v.device import U3vDevice
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.timeline import Timeline
from drivers.sim.usb.virtual_clock import VirtualClock

VISION = "usb3-vision"
"""The model of cameras that are no still cameras."""


class BusRig:
    """The cameras of a rig as devices: `backend` and `clock` are what drivers are given.

    model: a profile of PTP, or VISION. bandwidth: of the bus, see there. clock: its timeline; None: a virtual
    one. faults: planned faults and their times; mix: random faults, by the rig's seed; `plan.log` lists those
    that occurred.
    """

    def __init__(
        self,
        rig: SimulatedRig,
        faults: Sequence[Fault] = (),
        mix: Mix | None = None,
        model: str = "generic",
        bandwidth: float | None = None,
        clock: Timeline | None = None,
    ) -> None:
        self.clock = VirtualClock() if clock is None else clock
        self.backend = VirtualBus(self.clock, bandwidth)
        self.plan = FaultPlan(self.clock, faults, mix, rig.seed)
        for device in rig.devices:
            if model == VISION:
                self.backend.plug(U3vDevice(device, self.clock, self.plan))
            else:
                self.backend.plug(PtpDevice(Responder(device, profile(model), self.clock, self.plan)))
        self._serials = [device.body.serial for device in rig.devices]

    def cameras(self) -> list[Camera]:
        """Every camera through its driver, in the order of the rig's records."""
        cameras: list[Camera] = [*ptp.find_cameras(self.backend, self.clock)]
        cameras += u3v.find_cameras(self.backend, self.clock)
        by_serial = {camera.identify().serial: camera for camera in cameras}
        return [by_serial[serial] for serial in self._serials]
