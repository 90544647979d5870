"""Simulated PTP cameras on the virtual bus, spoken to in bytes: the standard's way."""

import struct
from collections.abc import Callable
from fractions import Fraction
from io import BytesIO
from typing import Any

import exifread
import numpy as np
import pytest
import rawpy

from drivers.ptp.protocol.codec import Event, unpack_value
from drivers.ptp.protocol.codes import (
    DataType,
    EventCode,
    FormatCode,
    Operation,
    PropertyCode,
    ResponseCode,
)
from drivers.ptp.protocol.datasets import DeviceInfo, DevicePropDesc, EnumForm, ObjectInfo, StorageInfo
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.ptp.profiles import PROFILES, profile
from drivers.usb import STILL_IMAGE, EndpointStalled, find
from tests.drivers.shots import raw_shot

OK = ResponseCode.OK
Plug = Callable[..., Any]


def test_device_info_is_what_the_profile_says(plug: Plug) -> None:
    for name, one in PROFILES.items():
        host = plug(name)
        info = DeviceInfo.unpack(host.get(Operation.GET_DEVICE_INFO))
        assert (info.manufacturer, info.model) == (one.maker, one.model)
        assert info.serial == find(STILL_IMAGE, host.bus)[0].serial() == "SIM-RAW-001"
        assert info.vendor_extension == one.extension
        for code in info.properties:
            description = DevicePropDesc.unpack(host.get(Operation.GET_DEVICE_PROP_DESC, code))
            assert description.code == code
            if isinstance(description.form, EnumForm):
                assert description.current in description.form.values


def test_a_shot_ends_after_its_exposure_in_virtual_time(plug: Plug) -> None:
    host = plug()
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


def test_the_file_is_a_dng_of_the_sensors_frame(plug: Plug) -> None:
    host = plug()
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
        host.responder.shooting.camera.body, lambda frame: host.rig.radiance(0, frame)
    )
    assert np.array_equal(pixels, raw_shot(reference, host.responder.shooting.exposure).pixels)
    pieces = [host.get(Operation.GET_PARTIAL_OBJECT, handle, at, 1000) for at in range(0, len(data), 1000)]
    assert b"".join(pieces) == data
    assert host.run(Operation.DELETE_OBJECT, handle).code == OK
    assert host.run(Operation.GET_OBJECT, handle).code == ResponseCode.INVALID_OBJECT_HANDLE


def test_a_camera_that_develops_itself_stores_jpeg(plug: Plug) -> None:
    host = plug(rig="toy-ldr")
    data = host.get(Operation.GET_OBJECT, host.shoot())
    assert data[:3] == b"\xff\xd8\xff"


def test_objects_are_listed_by_storage_format_and_folder(plug: Plug) -> None:
    host = plug()
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


def test_what_cannot_be_is_refused_by_its_own_code(plug: Plug) -> None:
    host = plug()
    time = PropertyCode.EXPOSURE_TIME
    assert host.set(time, DataType.UINT32, 41) == ResponseCode.INVALID_DEVICE_PROP_VALUE
    assert host.set(time, DataType.UINT16, 40) == ResponseCode.INVALID_DEVICE_PROP_FORMAT
    assert host.set(PropertyCode.BATTERY_LEVEL, DataType.UINT8, 5) == ResponseCode.ACCESS_DENIED
    assert host.set(0x5FFF, DataType.UINT8, 5) == ResponseCode.DEVICE_PROP_NOT_SUPPORTED
    assert host.run(Operation.SELF_TEST).code == ResponseCode.OPERATION_NOT_SUPPORTED
    assert host.run(Operation.OPEN_SESSION, 1).code == ResponseCode.SESSION_ALREADY_OPENED
    assert host.run(Operation.CLOSE_SESSION).code == OK
    assert host.run(Operation.GET_STORAGE_IDS).code == ResponseCode.SESSION_NOT_OPEN


def test_nonsense_halts_the_pipe_and_a_reset_mends_it(plug: Plug) -> None:
    host = plug()
    host.pipe.write(host.pipe.endpoint(into_host=False), b"nonsense, and no header", 1.0)
    with pytest.raises(EndpointStalled):
        host.pipe.read(host.incoming, 512, 1.0)
    status = host.pipe.control_in(0xA1, 0x67, 0, 64, 1.0)
    assert struct.unpack("<HHII", status) == (12, ResponseCode.TRANSACTION_CANCELLED, 0x02, 0x81)
    host.pipe.control_out(0x21, 0x66, 0, b"", 1.0)
    assert struct.unpack("<HH", host.pipe.control_in(0xA1, 0x67, 0, 64, 1.0)) == (4, OK)
    host.transaction = 0
    assert host.run(Operation.OPEN_SESSION, 1).code == OK
