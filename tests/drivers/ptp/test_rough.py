"""Several cameras at once on a bus where a twentieth of all operations fails, and many sessions in a row."""

import math
import threading
from dataclasses import replace

import pytest

from drivers.ptp import PtpCamera, find_cameras
from drivers.sim.bus_rig import BusRig
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import ROUGH, Fault, FaultPlan, Kind, Mix
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock, Worker
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure

CAMERAS, TIMES = 3, (1 / 1000, 1 / 60, 1 / 4, 2.0, 1 / 60, 1 / 250)
ATTEMPTS = 3
"""Attempts of a capture at an exposure without a frame."""


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy")


class Row:
    """Cameras of one profile on a bus, worked by a thread each."""

    def __init__(self, rig: SimulatedRig, name: str, mix: Mix | None) -> None:
        self.clock = VirtualClock()
        self.bus = VirtualBus(self.clock)
        self.plan = FaultPlan(self.clock, mix=mix, seed=5)
        for index in range(CAMERAS):
            body = SimulatedCamera(
                replace(rig.bodies[0], serial=f"ROW-{index}"), lambda frame: rig.radiance(0, frame)
            )
            self.bus.plug(PtpDevice(Responder(body, profile(name), self.clock, self.plan)))
        self.got: dict[str, list[float]] = {}

    def shoot(self) -> float:
        """All exposures with all cameras; the seconds that the slowest took."""
        cameras = find_cameras(self.bus, self.clock)
        workers = [self.clock.worker(str(index)) for index in range(CAMERAS)]
        threads = [
            threading.Thread(target=self.work, args=pair) for pair in zip(cameras, workers, strict=True)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return self.clock.now()

    def work(self, camera: PtpCamera, worker: Worker) -> None:
        with worker:
            got = [self.taken(camera, time) for time in TIMES]
            self.got[camera.identify().serial] = got
            camera.close()

    def taken(self, camera: PtpCamera, time: float) -> float:
        for _ in range(ATTEMPTS):
            try:
                camera.set_exposure(Exposure(time=time, f_number=5.6, iso=100))
                camera.arm()
                camera.trigger()
                exposure = camera.collect().metadata.exposure
            except CameraError:
                continue
            assert exposure is not None
            return exposure.time
        return math.nan


@pytest.mark.parametrize("name", PROFILES)
def test_every_frame_of_every_camera_is_right_and_runs_repeat(toy: SimulatedRig, name: str) -> None:
    smooth, rough, again = Row(toy, name, None), Row(toy, name, ROUGH), Row(toy, name, ROUGH)
    spent = smooth.shoot(), rough.shoot(), again.shoot()
    for row in (smooth, rough, again):
        assert sorted(row.got) == [f"ROW-{index}" for index in range(CAMERAS)]
        for times in row.got.values():
            assert times == pytest.approx(TIMES, rel=1e-5)
        assert row.bus.open_handles == 0
    assert rough.plan.log
    assert spent[1] == spent[2]
    assert [str(one) for one in rough.plan.log] == [str(one) for one in again.plan.log]


def test_sessions_leave_nothing_open(toy: SimulatedRig) -> None:
    row = Row(toy, "generic", None)
    for _ in range(50):
        for camera in find_cameras(row.bus, row.clock):
            camera.identify()
            camera.close()
            camera.close()
        assert row.bus.open_handles == 0


@pytest.mark.parametrize(
    ("operation", "lost"), [("DEVICE_READY", 1.2), ("GET_EVENT", 1.2), ("GET_OBJECT", 2.2)]
)
def test_a_nikon_whose_answer_is_lost_costs_no_more_than_asking_again(
    toy: SimulatedRig, operation: str, lost: float
) -> None:
    """Seconds, by how soon it is asked again."""
    times = []
    for faults in ((), (Fault(Kind.TIMEOUT, operation=operation, nth=3),)):
        bus = BusRig(toy, faults, model="nikon-z6")
        camera = bus.cameras()[0]
        for _ in range(4):
            camera.set_exposure(Exposure(time=1 / 60, f_number=4.0, iso=100.0))
            camera.arm()
            camera.trigger()
            frame = camera.collect()
            assert frame.metadata.exposure == Exposure(time=1 / 60, f_number=4.0, iso=100.0)
        assert len(bus.plan.log) == len(faults)
        times.append(bus.clock.now())
        camera.close()
    assert 0.5 < times[1] - times[0] < lost
