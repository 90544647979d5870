"""Simulated PTP cameras on the virtual bus: every fault of the camera and of the way to it."""

import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from typing import Any

import exifread
import pytest

from drivers.camera import CameraFile
from drivers.errors import CameraLost, CameraTimeout
from drivers.ptp.camera import PtpCamera, find_cameras
from drivers.ptp.protocol.codec import Command, Event, Header
from drivers.ptp.protocol.codes import (
    DataType,
    EventCode,
    Operation,
    PropertyCode,
    ResponseCode,
)
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import ROUGH, Fault, FaultPlan, Kind
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock, Worker
from drivers.usb import STILL_IMAGE, EndpointStalled, find
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure

OK = ResponseCode.OK
Plug = Callable[..., Any]


def test_busy_for_a_time_and_for_a_number_of_operations(plug: Plug) -> None:
    busy = Fault(Kind.BUSY, operation="GET_STORAGE_IDS", nth=1, seconds=0.05)
    again = Fault(Kind.BUSY, operation="GET_STORAGE_IDS", nth=2, count=2)
    host = plug("generic", busy, again)
    busy_code, ids = ResponseCode.DEVICE_BUSY, Operation.GET_STORAGE_IDS
    assert [host.run(ids).code, host.run(ids).code] == [busy_code, busy_code]
    host.clock.sleep(0.05)
    assert [host.run(ids).code for _ in range(3)] == [busy_code, busy_code, OK]
    assert [one.fault for one in host.plan.log] == [busy, again]


@pytest.mark.parametrize(
    ("kind", "codes", "delay"),
    [
        (Kind.LOST_EVENT, [EventCode.CAPTURE_COMPLETE], 0.0),
        (Kind.LATE_EVENT, [EventCode.OBJECT_ADDED, EventCode.CAPTURE_COMPLETE], 2.0),
        (Kind.REORDERED_EVENTS, [EventCode.CAPTURE_COMPLETE, EventCode.OBJECT_ADDED], 0.0),
        (Kind.SLOW_CARD, [EventCode.OBJECT_ADDED, EventCode.CAPTURE_COMPLETE], 2.0),
    ],
)
def test_events_lost_late_and_out_of_order(
    plug: Plug, kind: Kind, codes: list[EventCode], delay: float
) -> None:
    host = plug("generic", Fault(kind, operation="INITIATE_CAPTURE", seconds=2.0))
    began = host.clock.now()
    assert host.run(Operation.INITIATE_CAPTURE, 0, 0).code == OK
    endpoint = host.pipe.endpoint(into_host=True, interrupt=True)
    first = Event.unpack(host.pipe.read(endpoint, 32, 10.0))
    assert host.clock.now() - began == pytest.approx(1 / 64 + 0.15 + delay, abs=0.01)
    assert [first.code, *(event.code for event in host.events(5.0))] == codes


def test_a_wrong_exposure_is_told_by_the_file_alone(plug: Plug) -> None:
    host = plug("generic", Fault(Kind.EXPOSURE_OFF, operation="INITIATE_CAPTURE", share=1.0))
    assert host.set(PropertyCode.EXPOSURE_TIME, DataType.UINT32, 40) == OK
    data = host.get(Operation.GET_OBJECT, host.shoot())
    assert host.get(Operation.GET_DEVICE_PROP_VALUE, PropertyCode.EXPOSURE_TIME) == struct.pack("<I", 40)
    tags = exifread.process_file(BytesIO(data), details=False)
    assert tags["EXIF ExposureTime"].values == [Fraction(1, 125)]


def test_a_full_store_refuses_until_something_is_deleted(plug: Plug) -> None:
    host = plug("generic", Fault(Kind.STORE_FULL, operation="INITIATE_CAPTURE", nth=2))
    handle = host.shoot()
    assert host.run(Operation.INITIATE_CAPTURE, 0, 0).code == ResponseCode.STORE_FULL
    assert host.run(Operation.DELETE_OBJECT, handle).code == OK
    host.shoot()


def transfers(plug: Plug, fault: Fault) -> list[bytes]:
    """Transfers of GetDeviceInfo, read by read."""
    host = plug("generic", fault)
    out = host.pipe.endpoint(into_host=False)
    host.pipe.write(out, Command(Operation.GET_DEVICE_INFO, 1).pack(), 1.0)
    parts = []
    while True:
        try:
            parts.append(host.pipe.read(host.incoming, 4096, 0.5))
        except CameraTimeout:
            return parts


def test_how_an_answer_is_cut_into_transfers(plug: Plug) -> None:
    def fault(kind: Kind, count: int = 0) -> Fault:
        return Fault(kind, operation="GET_DEVICE_INFO", count=count)

    data, response = transfers(plug, fault(Kind.NO_TRAILER))  # which PTP cannot have: the plain answer
    assert transfers(plug, fault(Kind.SPLIT_HEADER)) == [data[:12], data[12:], response]
    assert transfers(plug, fault(Kind.MERGED_RESPONSE)) == [data + response]
    assert transfers(plug, fault(Kind.TRUNCATED, 40)) == [data[:52], response]
    assert transfers(plug, fault(Kind.TIMEOUT)) == []
    longer, _ = transfers(plug, fault(Kind.CORRUPT_LENGTH, 7))
    assert Header.unpack(longer).length == Header.unpack(data).length + 7
    assert longer[4:] == data[4:]
    ids = [Header.unpack(one).transaction for one in transfers(plug, fault(Kind.WRONG_TRANSACTION))]
    assert ids == [2, 2]


def test_a_stall_halts_until_it_is_cleared(plug: Plug) -> None:
    host = plug("generic", Fault(Kind.STALL, operation="GET_STORAGE_IDS"))
    with pytest.raises(EndpointStalled):
        host.run(Operation.GET_STORAGE_IDS)
    with pytest.raises(EndpointStalled):
        host.read()
    host.pipe.clear_halt(host.incoming)
    assert host.run(Operation.GET_STORAGE_IDS).code == OK


def test_unplugged_in_a_download_and_back_with_its_files(plug: Plug) -> None:
    cut = Fault(Kind.UNPLUG, operation="GET_OBJECT", count=2000, seconds=0.3)
    host = plug("generic", cut)
    handle = host.shoot()
    with pytest.raises(CameraLost):
        host.run(Operation.GET_OBJECT, handle)
    host.pipe.close()
    assert find(STILL_IMAGE, host.bus) == []
    host.clock.sleep(0.3)
    (discovered,) = find(STILL_IMAGE, host.bus)
    assert (discovered.device.address, discovered.serial()) == (2, "SIM-RAW-001")
    host.connect()
    assert len(host.get(Operation.GET_OBJECT, handle)) > 2000


def driven(rig_name: str, seed: int) -> tuple[list[object], list[object]]:
    """Eight cameras, each in a thread of its own with our driver; what they shot and what went wrong."""
    rig = simulate(rig_name, cameras=8)
    clock = VirtualClock()
    bus = VirtualBus(clock)
    plan = FaultPlan(clock, mix=ROUGH, seed=seed)
    for index, name in enumerate((2 * list(PROFILES))[:8]):
        camera = rig.cameras[index]
        assert isinstance(camera, SimulatedCamera)
        bus.plug(PtpDevice(Responder(camera, profile(name), clock, plan)))
    shots: list[object] = []
    jobs = [(discovered, clock.worker(discovered.where)) for discovered in find_cameras(bus, clock)]

    def work(camera: PtpCamera, worker: Worker) -> None:
        with worker:
            for time in (1 / 500, 1 / 15, 2.0):
                for _ in range(5):
                    with suppress(CameraError):  # what a driver gives up is shot again
                        camera.set_exposure(Exposure(time=time, f_number=4.0, iso=100.0))
                        camera.arm()
                        camera.trigger()
                        frame = camera.collect()
                        break
                assert isinstance(frame, CameraFile)
                metadata = frame.metadata
                shots.append((clock.now(), metadata.serial, metadata.exposure, frame.data))
            camera.close()

    threads = [threading.Thread(target=work, args=job) for job in jobs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return shots, list(plan.log)


def test_eight_cameras_with_faults_repeat_exactly_whatever_the_threads_do() -> None:
    shots, faults = driven("toy", 1)
    assert driven("toy", 1) == (shots, faults)
    assert len({(one[1], one[2]) for one in shots}) == len(shots) == 24  # type: ignore[index]
    assert len(faults) > 24
    assert driven("toy", 2)[1] != faults
