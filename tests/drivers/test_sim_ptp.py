"""Simulated PTP cameras on the virtual bus, spoken to in bytes: standard and makers' ways, and faults."""

import os
import struct
import threading
from contextlib import suppress
from fractions import Fraction
from io import BytesIO
from pathlib import Path

import exifread
import numpy as np
import pytest
import rawpy

from drivers.errors import CameraLost, CameraTimeout
from drivers.ptp.camera import PtpCamera, find_cameras
from drivers.ptp.codec import Command, Data, Event, Header, Response, pack_value, parse, unpack_value
from drivers.ptp.codes import (
    CanonOperation,
    CanonProperty,
    DataType,
    EventCode,
    FormatCode,
    NikonOperation,
    NikonProperty,
    Operation,
    PropertyCode,
    ResponseCode,
    SonyOperation,
    SonyProperty,
)
from drivers.ptp.datasets import DeviceInfo, DevicePropDesc, EnumForm, ObjectInfo, StorageInfo
from drivers.sim import shutter
from drivers.sim.bus import VirtualBus
from drivers.sim.camera import SimulatedCamera
from drivers.sim.faults import ROUGH, Fault, FaultPlan, Kind
from drivers.sim.ptp_dials import CANON_TIME, EXPOSURE_TIME, NIKON_TIME, SONY_TIME, TIMES
from drivers.sim.ptp_profiles import PROFILES, profile
from drivers.sim.ptp_responder import Responder
from drivers.sim.ptp_usb import PtpDevice
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.virtual_clock import VirtualClock, Worker
from drivers.usb import STILL_IMAGE, EndpointStalled, find
from imaging.errors import CameraError
from imaging.exposure import Exposure
from imaging.mosaic import RawMosaic

OK = ResponseCode.OK


@pytest.fixture(scope="module")
def rigs() -> dict[str, SimulatedRig]:
    return {name: simulate(name) for name in ("toy", "toy-ldr")}


class Host:
    """A PTP initiator of few words: one transaction after the other, no recovery."""

    def __init__(self, rig: SimulatedRig, name: str = "generic", *faults: Fault) -> None:
        self.clock = VirtualClock()
        self.bus = VirtualBus(self.clock)
        self.plan = FaultPlan(self.clock, faults)
        camera = SimulatedCamera(rig.bodies[0], lambda frame: rig.radiance(0, frame))
        self.responder = Responder(camera, profile(name), self.clock, self.plan)
        self.bus.plug(PtpDevice(self.responder))
        self.surplus = b""
        self.connect()

    def connect(self) -> None:
        self.pipe = find(STILL_IMAGE, self.bus)[0].open()
        self.incoming = self.pipe.endpoint(into_host=True)
        self.transaction = 0
        assert self.run(Operation.OPEN_SESSION, 1).code == OK

    def read(self, timeout: float = 1.0) -> bytes:
        data = self.surplus or self.pipe.read(self.incoming, 1 << 20, timeout)
        self.surplus = b""
        length = Header.unpack(data).length
        while len(data) < length:
            piece = self.pipe.read(self.incoming, 1 << 20, timeout)
            assert piece
            data += piece
        self.surplus = data[length:]
        return data[:length]

    def run(self, operation: int, *parameters: int, data: bytes | None = None) -> Response:
        """The response; `self.data` is what came before it."""
        command = Command(operation, self.transaction, parameters)
        self.transaction += 1
        out = self.pipe.endpoint(into_host=False)
        self.pipe.write(out, command.pack(), 1.0)
        if data is not None:
            self.pipe.write(out, Data(operation, command.transaction, data).pack(), 1.0)
        self.data = b""
        answer = parse(self.read())
        if isinstance(answer, Data):
            self.data = answer.payload
            answer = parse(self.read())
        assert isinstance(answer, Response)
        assert answer.transaction == command.transaction
        return answer

    def get(self, operation: int, *parameters: int) -> bytes:
        assert self.run(operation, *parameters).code == OK
        return self.data

    def events(self, seconds: float) -> list[Event]:
        """What comes until nothing has come for that long."""
        found, endpoint = [], self.pipe.endpoint(into_host=True, interrupt=True)
        while True:
            try:
                found.append(Event.unpack(self.pipe.read(endpoint, 32, seconds)))
            except CameraTimeout:
                return found

    def set(self, code: int, kind: DataType, value: int) -> int:
        return self.run(Operation.SET_DEVICE_PROP_VALUE, code, data=pack_value(kind, value)).code

    def shoot(self) -> int:
        """A shot of the standard's kind; the handle of its file."""
        assert self.run(Operation.INITIATE_CAPTURE, 0, 0).code == OK
        added = [event for event in self.events(5.0) if event.code == EventCode.OBJECT_ADDED]
        assert len(added) == 1
        return added[0].parameters[0]


def test_device_info_is_what_the_profile_says(rigs: dict[str, SimulatedRig]) -> None:
    for name, one in PROFILES.items():
        host = Host(rigs["toy"], name)
        info = DeviceInfo.unpack(host.get(Operation.GET_DEVICE_INFO))
        assert (info.manufacturer, info.model) == (one.maker, one.model)
        assert info.serial == find(STILL_IMAGE, host.bus)[0].serial() == "SIM-RAW-001"
        assert info.vendor_extension == one.extension
        for code in info.properties:
            told = DevicePropDesc.unpack(host.get(Operation.GET_DEVICE_PROP_DESC, code))
            assert told.code == code
            if isinstance(told.form, EnumForm):
                assert told.current in told.form.values


def test_a_shot_ends_after_its_exposure_in_virtual_time(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"])
    assert host.set(PropertyCode.EXPOSURE_TIME, DataType.UINT32, 300_000) == OK
    began, transaction = host.clock.now(), host.transaction
    assert host.run(Operation.INITIATE_CAPTURE, 0, 0).code == OK
    assert host.run(Operation.INITIATE_CAPTURE, 0, 0).code == ResponseCode.DEVICE_BUSY
    assert host.set(PropertyCode.EXPOSURE_TIME, DataType.UINT32, 40) == ResponseCode.DEVICE_BUSY
    endpoint = host.pipe.endpoint(into_host=True, interrupt=True)
    added = Event.unpack(host.pipe.read(endpoint, 32, 60.0))
    # "30 s" is 32 s, and the file has to be written.
    assert host.clock.now() - began == pytest.approx(32.0 + profile("generic").write, abs=0.01)
    assert (added.code, added.transaction) == (EventCode.OBJECT_ADDED, transaction)
    assert [event.code for event in host.events(1.0)] == [EventCode.CAPTURE_COMPLETE]


def exif(data: bytes, *names: str) -> list[object]:
    tags = exifread.process_file(BytesIO(data), details=False)
    return [tags[f"EXIF {name}"].values[0] for name in names]


def test_the_file_is_a_dng_of_the_sensors_frame(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"])
    assert host.set(PropertyCode.EXPOSURE_TIME, DataType.UINT32, 40) == OK
    assert host.set(PropertyCode.EXPOSURE_INDEX, DataType.UINT16, 400) == OK
    handle = host.shoot()
    info = ObjectInfo.unpack(host.get(Operation.GET_OBJECT_INFO, handle))
    data = host.get(Operation.GET_OBJECT, handle)
    assert (info.size, info.format, info.filename) == (len(data), FormatCode.DNG, "IMG_0001.DNG")
    with rawpy.imread(BytesIO(data)) as raw:
        pixels = raw.raw_image.copy()
    assert exif(data, "ExposureTime", "ISOSpeedRatings") == [Fraction(1, 250), 400]
    reference = SimulatedCamera(
        host.responder.shooting.camera.body, lambda frame: rigs["toy"].radiance(0, frame)
    )
    reference.set_exposure(host.responder.shooting.exposure)
    reference.arm()
    reference.trigger()
    assert np.array_equal(pixels, reference.collect().pixels)
    pieces = [host.get(Operation.GET_PARTIAL_OBJECT, handle, at, 1000) for at in range(0, len(data), 1000)]
    assert b"".join(pieces) == data
    assert host.run(Operation.DELETE_OBJECT, handle).code == OK
    assert host.run(Operation.GET_OBJECT, handle).code == ResponseCode.INVALID_OBJECT_HANDLE


def test_a_camera_that_develops_itself_stores_jpeg(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy-ldr"])
    data = host.get(Operation.GET_OBJECT, host.shoot())
    assert data[:3] == b"\xff\xd8\xff"


def test_objects_are_listed_by_storage_format_and_folder(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"])
    handles = [host.shoot(), host.shoot()]

    def listed(*parameters: int) -> tuple[int, ...]:
        answer = unpack_value(DataType.ARRAY_UINT32, host.get(Operation.GET_OBJECT_HANDLES, *parameters))
        assert isinstance(answer, tuple)
        return answer

    (root,) = listed(0xFFFFFFFF, 0, 0xFFFFFFFF)
    (folder,) = listed(0xFFFFFFFF, 0, root)
    assert list(listed(0xFFFFFFFF, 0, folder)) == handles
    assert list(listed(0xFFFFFFFF, FormatCode.DNG, 0)) == handles
    assert listed(0xFFFFFFFF, 0, 0) == (root, folder, *handles)
    assert ObjectInfo.unpack(host.get(Operation.GET_OBJECT_INFO, folder)).parent == root
    assert host.run(Operation.GET_OBJECT_HANDLES, 0x99, 0, 0).code == ResponseCode.INVALID_STORAGE_ID
    (storage,) = unpack_value(DataType.ARRAY_UINT32, host.get(Operation.GET_STORAGE_IDS))  # type: ignore[misc]
    before = StorageInfo.unpack(host.get(Operation.GET_STORAGE_INFO, storage)).free_bytes
    host.shoot()
    assert StorageInfo.unpack(host.get(Operation.GET_STORAGE_INFO, storage)).free_bytes < before


def test_what_cannot_be_is_refused_by_its_own_code(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"])
    time = PropertyCode.EXPOSURE_TIME
    assert host.set(time, DataType.UINT32, 41) == ResponseCode.INVALID_DEVICE_PROP_VALUE
    assert host.set(time, DataType.UINT16, 40) == ResponseCode.INVALID_DEVICE_PROP_FORMAT
    assert host.set(PropertyCode.BATTERY_LEVEL, DataType.UINT8, 5) == ResponseCode.ACCESS_DENIED
    assert host.set(0x5FFF, DataType.UINT8, 5) == ResponseCode.DEVICE_PROP_NOT_SUPPORTED
    assert host.run(Operation.SELF_TEST).code == ResponseCode.OPERATION_NOT_SUPPORTED
    assert host.run(Operation.OPEN_SESSION, 1).code == ResponseCode.SESSION_ALREADY_OPENED
    assert host.run(Operation.CLOSE_SESSION).code == OK
    assert host.run(Operation.GET_STORAGE_IDS).code == ResponseCode.SESSION_NOT_OPEN


def test_nonsense_halts_the_pipe_and_a_reset_mends_it(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"])
    host.pipe.write(host.pipe.endpoint(into_host=False), b"nonsense, and no header", 1.0)
    with pytest.raises(EndpointStalled):
        host.pipe.read(host.incoming, 512, 1.0)
    status = host.pipe.control_in(0xA1, 0x67, 0, 64, 1.0)
    assert struct.unpack("<HHII", status) == (12, ResponseCode.TRANSACTION_CANCELLED, 0x02, 0x81)
    host.pipe.control_out(0x21, 0x66, 0, b"", 1.0)
    assert struct.unpack("<HH", host.pipe.control_in(0xA1, 0x67, 0, 64, 1.0)) == (4, OK)
    host.transaction = 0
    assert host.run(Operation.OPEN_SESSION, 1).code == OK


def test_nikon_sets_exact_times_and_keeps_a_shot_in_memory(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"], "nikon-z6")
    assert host.run(NikonOperation.CHANGE_CAMERA_MODE, 1).code == OK
    # 1/6400 s and 1/8000 s are both 1 in hundreds of microseconds.
    assert host.set(NikonProperty.SHUTTER_SPEED, DataType.UINT32, 1 << 16 | 6400) == OK
    assert host.get(Operation.GET_DEVICE_PROP_VALUE, PropertyCode.EXPOSURE_TIME) == struct.pack("<I", 1)
    assert host.responder.shooting.exposure.time == 1 / 6400
    media = NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA
    host.get(NikonOperation.GET_EVENT)
    assert host.run(media, 0xFFFFFFFF, 1).code == OK
    assert host.run(NikonOperation.DEVICE_READY).code == ResponseCode.DEVICE_BUSY
    host.clock.sleep(1.0)
    assert host.run(NikonOperation.DEVICE_READY).code == OK
    packed = host.get(NikonOperation.GET_EVENT)
    assert struct.unpack("<HHIHI", packed) == (2, 0xC101, 0xFFFF0001, 0xC102, 0)
    assert host.run(media, 0xFFFFFFFF, 1).code == ResponseCode.DEVICE_BUSY
    assert host.get(Operation.GET_OBJECT, 0xFFFF0001)[:4] == b"II*\0"
    assert host.run(Operation.DELETE_OBJECT, 0xFFFF0001).code == OK
    assert host.run(media, 0xFFFFFFFF, 1).code == OK


def canon_records(packed: bytes) -> list[tuple[int, bytes]]:
    records = []
    while packed:
        length, kind = struct.unpack_from("<II", packed)
        records.append((kind, packed[8:length]))
        packed = packed[length:]
    assert records.pop() == (0, b"")
    return records


def test_canon_tells_values_in_records_and_waits_for_the_transfer(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"], "canon-eos-6d")
    for operation in (CanonOperation.SET_REMOTE_MODE, CanonOperation.SET_EVENT_MODE):
        assert host.run(operation, 1).code == OK
    told = canon_records(host.get(CanonOperation.GET_EVENT))
    values = {struct.unpack_from("<II", body) for kind, body in told if kind == 0xC189}
    assert {(0xD102, 0x68), (0xD101, 0x28), (0xD103, 0x48), (0xD11C, 2)} <= values  # 1/60 f/4 ISO 100, card
    assert canon_records(host.get(CanonOperation.GET_EVENT)) == []

    def put(code: int, value: int) -> int:
        packed = struct.pack("<III", 12, code, value)
        return host.run(CanonOperation.SET_DEVICE_PROP_VALUE_EX, data=packed).code

    assert put(CanonProperty.SHUTTER_SPEED, 0x70) == OK
    assert put(CanonProperty.SHUTTER_SPEED, 0x71) == ResponseCode.INVALID_DEVICE_PROP_VALUE
    assert host.responder.shooting.exposure.time == 1 / 125
    assert put(CanonProperty.CAPTURE_DESTINATION, 4) == OK
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == ResponseCode.STORE_FULL
    assert host.run(CanonOperation.PC_HDD_CAPACITY, 0x7FFFFFFF, 0x1000, 1).code == OK
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 1).code == OK
    host.get(CanonOperation.GET_EVENT)
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == OK
    host.clock.sleep(1.0)
    ((kind, body),) = canon_records(host.get(CanonOperation.GET_EVENT))
    handle, _, _, size = struct.unpack_from("<IIII", body)
    assert (kind, body[20:].rstrip(b"\0")) == (0xC186, b"IMG_0001.DNG")
    data = host.get(CanonOperation.GET_PARTIAL_OBJECT, handle, 0, size)
    assert len(data) == size
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == ResponseCode.DEVICE_BUSY
    assert host.run(CanonOperation.TRANSFER_COMPLETE, handle).code == OK
    assert host.run(CanonOperation.REMOTE_RELEASE_ON, 2).code == OK


def test_sony_wants_its_handshake_and_frees_memory_when_read(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"], "sony-a7m4")
    everything = SonyOperation.GET_ALL_EXT_DEVICE_PROP_INFO
    assert host.run(everything).code == ResponseCode.ACCESS_DENIED
    for phase in (1, 2):
        host.get(SonyOperation.SDIO_CONNECT, phase, 0, 0)
    assert host.get(SonyOperation.GET_EXT_DEVICE_INFO, 0xC8, 1)[:2] == b"\xc8\0"
    host.get(SonyOperation.SDIO_CONNECT, 3, 0, 0)

    def value(code: int) -> int:
        blob = host.get(everything)
        at = blob.index(struct.pack("<H", code), 8)
        kind = DataType(struct.unpack_from("<H", blob, at + 2)[0])
        return int.from_bytes(blob[at + 6 + kind.item_size :][: kind.item_size], "little")

    packed = struct.pack("<I", 1 << 16 | 250)
    assert host.run(SonyOperation.SET_CONTROL_A, SonyProperty.SHUTTER_SPEED, data=packed).code == OK
    assert value(SonyProperty.SHUTTER_SPEED) == 1 << 16 | 250
    assert host.run(SonyOperation.SET_CONTROL_B, SonyProperty.SHUTTER_SPEED, data=b"\xff").code == OK
    assert value(SonyProperty.SHUTTER_SPEED) == 1 << 16 | 200
    for button in (SonyProperty.HALF_PRESS, SonyProperty.FULL_PRESS):
        assert host.run(SonyOperation.SET_CONTROL_B, button, data=b"\2\0").code == OK
    assert value(SonyProperty.OBJECT_IN_MEMORY) == 0
    assert [(event.code, event.parameters) for event in host.events(1.0)] == [(0xC201, (0xFFFFC001,))]
    assert value(SonyProperty.OBJECT_IN_MEMORY) >= 0x8000
    assert len(host.get(Operation.GET_OBJECT, 0xFFFFC001)) > 1000
    assert value(SonyProperty.OBJECT_IN_MEMORY) == 0


def test_busy_for_a_time_and_for_a_number_of_operations(rigs: dict[str, SimulatedRig]) -> None:
    busy = Fault(Kind.BUSY, operation="GET_STORAGE_IDS", nth=1, seconds=0.05)
    again = Fault(Kind.BUSY, operation="GET_STORAGE_IDS", nth=2, count=2)
    host = Host(rigs["toy"], "generic", busy, again)
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
    rigs: dict[str, SimulatedRig], kind: Kind, codes: list[EventCode], delay: float
) -> None:
    host = Host(rigs["toy"], "generic", Fault(kind, operation="INITIATE_CAPTURE", seconds=2.0))
    began = host.clock.now()
    assert host.run(Operation.INITIATE_CAPTURE, 0, 0).code == OK
    endpoint = host.pipe.endpoint(into_host=True, interrupt=True)
    first = Event.unpack(host.pipe.read(endpoint, 32, 10.0))
    assert host.clock.now() - began == pytest.approx(1 / 64 + 0.15 + delay, abs=0.01)
    assert [first.code, *(event.code for event in host.events(5.0))] == codes


def test_a_wrong_exposure_is_told_by_the_file_alone(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"], "generic", Fault(Kind.EXPOSURE_OFF, operation="INITIATE_CAPTURE", share=1.0))
    assert host.set(PropertyCode.EXPOSURE_TIME, DataType.UINT32, 40) == OK
    data = host.get(Operation.GET_OBJECT, host.shoot())
    assert host.get(Operation.GET_DEVICE_PROP_VALUE, PropertyCode.EXPOSURE_TIME) == struct.pack("<I", 40)
    assert exif(data, "ExposureTime") == [Fraction(1, 125)]


def test_a_full_store_refuses_until_something_is_deleted(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"], "generic", Fault(Kind.STORE_FULL, operation="INITIATE_CAPTURE", nth=2))
    handle = host.shoot()
    assert host.run(Operation.INITIATE_CAPTURE, 0, 0).code == ResponseCode.STORE_FULL
    assert host.run(Operation.DELETE_OBJECT, handle).code == OK
    host.shoot()


def transfers(rigs: dict[str, SimulatedRig], fault: Fault) -> list[bytes]:
    """What GetDeviceInfo brings, read by read."""
    host = Host(rigs["toy"], "generic", fault)
    out = host.pipe.endpoint(into_host=False)
    host.pipe.write(out, Command(Operation.GET_DEVICE_INFO, 1).pack(), 1.0)
    found = []
    while True:
        try:
            found.append(host.pipe.read(host.incoming, 4096, 0.5))
        except CameraTimeout:
            return found


def test_how_an_answer_is_cut_into_transfers(rigs: dict[str, SimulatedRig]) -> None:
    def fault(kind: Kind, count: int = 0) -> Fault:
        return Fault(kind, operation="GET_DEVICE_INFO", count=count)

    data, response = transfers(rigs, fault(Kind.NO_TRAILER))  # which PTP cannot have: the plain answer
    assert transfers(rigs, fault(Kind.SPLIT_HEADER)) == [data[:12], data[12:], response]
    assert transfers(rigs, fault(Kind.MERGED_RESPONSE)) == [data + response]
    assert transfers(rigs, fault(Kind.TRUNCATED, 40)) == [data[:52], response]
    assert transfers(rigs, fault(Kind.TIMEOUT)) == []
    longer, _ = transfers(rigs, fault(Kind.CORRUPT_LENGTH, 7))
    assert Header.unpack(longer).length == Header.unpack(data).length + 7
    assert longer[4:] == data[4:]
    ids = [Header.unpack(one).transaction for one in transfers(rigs, fault(Kind.WRONG_TRANSACTION))]
    assert ids == [2, 2]


def test_a_stall_halts_until_it_is_cleared(rigs: dict[str, SimulatedRig]) -> None:
    host = Host(rigs["toy"], "generic", Fault(Kind.STALL, operation="GET_STORAGE_IDS"))
    with pytest.raises(EndpointStalled):
        host.run(Operation.GET_STORAGE_IDS)
    with pytest.raises(EndpointStalled):
        host.read()
    host.pipe.clear_halt(host.incoming)
    assert host.run(Operation.GET_STORAGE_IDS).code == OK


def test_unplugged_in_a_download_and_back_with_its_files(rigs: dict[str, SimulatedRig]) -> None:
    cut = Fault(Kind.UNPLUG, operation="GET_OBJECT", count=2000, seconds=0.3)
    host = Host(rigs["toy"], "generic", cut)
    handle = host.shoot()
    with pytest.raises(CameraLost):
        host.run(Operation.GET_OBJECT, handle)
    host.pipe.close()
    assert find(STILL_IMAGE, host.bus) == []
    host.clock.sleep(0.3)
    (found,) = find(STILL_IMAGE, host.bus)
    assert (found.device.address, found.serial()) == (2, "SIM-RAW-001")
    host.connect()
    assert len(host.get(Operation.GET_OBJECT, handle)) > 2000


@pytest.mark.parametrize(
    ("name", "line"), [("nikon-d780", 0x500D), ("nikon-d780", 0xD100), ("nikon-z6", 0xD100)]
)
def test_the_nikon_shutter_lists_are_those_of_real_bodies(name: str, line: int) -> None:
    if "RIG_DATA" not in os.environ:
        pytest.skip("RIG_DATA is not set: the answers of real cameras are not at hand")
    text = (Path(os.environ["RIG_DATA"]) / "ptp" / f"{name}.txt").read_text(errors="replace")
    listed = text.split(f"(0x{line:x}):")[1].split("Enumeration [")[1].split("]")[0]
    numbers = tuple(number for number in map(int, listed.split(",")) if number < 0xFFFFFFFD)
    dial = EXPOSURE_TIME if line == 0x500D else NIKON_TIME
    assert dial.numbers() == numbers


def test_shutter_codes_keep_the_known_points() -> None:
    canon = dict(CANON_TIME.positions)
    assert (canon[0x10], canon[0x38], canon[0x70], canon[0xA0]) == (30.0, 1.0, 1 / 125, 1 / 8000)
    assert len(canon) == len(SONY_TIME.numbers()) == len(TIMES) == len(shutter.APPLIED_TIME)
    assert (SONY_TIME.number(0.4), SONY_TIME.number(30.0)) == (4 << 16 | 10, 300 << 16 | 10)


def driven(rig_name: str, seed: int) -> tuple[list[object], list[object]]:
    """Eight cameras, each in a thread of its own with our driver; what they shot and what went wrong."""
    rig = simulate(rig_name, cameras=8)
    clock = VirtualClock()
    bus = VirtualBus(clock)
    plan = FaultPlan(clock, mix=ROUGH, seed=seed)
    for index, name in enumerate(2 * list(PROFILES)):
        camera = rig.cameras[index]
        assert isinstance(camera, SimulatedCamera)
        bus.plug(PtpDevice(Responder(camera, profile(name), clock, plan)))
    shots: list[object] = []
    jobs = [(found, clock.worker(found.where)) for found in find_cameras(bus, clock)]

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
                assert isinstance(frame, RawMosaic)
                told = frame.metadata
                shots.append((clock.now(), told.serial, told.exposure, frame.pixels.tobytes()))
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
