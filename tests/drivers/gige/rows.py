"""Simulated GigE Vision cameras on loopback."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass

import numpy as np

from drivers.clock import SystemClock
from drivers.gige import GigeCamera, find_cameras
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.genicam.quirks import Quirk
from drivers.sim.gige.clock import NetworkTime
from drivers.sim.gige.device import GigeDevice
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import LiveTimeline

from .fakes import only_at, own_address


@dataclass
class Row:
    """Devices, our cameras on them, and cameras that shoot the same without any network."""

    devices: list[GigeDevice]
    cameras: list[GigeCamera]
    twins: list[SimulatedCamera]

    def lose(self, share: float) -> None:
        """Drop that share of all packets from now on."""
        for device in self.devices:
            device.loss = device.sender.loss = share


MakeRow = Callable[..., Row]


@contextmanager
def rows() -> Iterator[MakeRow]:
    """Makes a row of `count` cameras of the toy rig, the skew of each after an action command given."""
    with ExitStack() as stack:

        def make(
            count: int = 1,
            *,
            bits: int = 12,
            skews: tuple[float, ...] = (),
            addresses: tuple[str, ...] = (),
            extended_ids: bool = False,
            synchronised: bool = True,
            quirks: frozenset[Quirk] = frozenset(),
            beside: str | None = None,
        ) -> Row:
            rig = simulate("toy", cameras=max(count, 2), bit_depth=bits, seed=5)
            views = [np.asarray(rig.radiance(index, 0)) for index in range(count)]
            timeline = stack.enter_context(closing(LiveTimeline()))

            def camera(index: int) -> SimulatedCamera:
                return SimulatedCamera(rig.bodies[index], lambda frame: views[index])

            places = addresses or tuple(own_address(index) for index in range(count))
            time = NetworkTime(seed=5) if synchronised else None
            devices = [
                stack.enter_context(
                    GigeDevice(
                        camera(index),
                        timeline,
                        places[index],
                        network_time=time,
                        skew=skews[index] if skews else 0.0,
                        extended_ids=extended_ids,
                        quirks=quirks,
                        beside=beside if index == 0 else None,
                    )
                )
                for index in range(count)
            ]
            asked = only_at(*places) if beside is None else only_at(beside, *places)
            cameras = find_cameras(asked, SystemClock())
            for one in cameras:
                stack.callback(one.close)
            return Row(devices, cameras, [camera(index) for index in range(count)])

        yield make
