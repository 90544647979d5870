"""Bodies that write RAW and JPEG, and what makes them write RAW at all."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from drivers.camera import CameraFile
from drivers.errors import CameraProtocol
from drivers.ptp import find_cameras
from drivers.ptp.protocol.codes import PropertyCode
from drivers.ptp.protocol.session import Download
from drivers.ptp.vendors.canon import CanonBody
from drivers.ptp.vendors.nikon import NikonBody, nef_setting
from drivers.ptp.vendors.sony import SonyBody
from drivers.ptp.vendors.standard import StandardBody
from drivers.sim.ptp.nikon import Nikon
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.ptp.store import Photograph, Store
from drivers.sim.rigs import SimulatedRig, simulate
from tests.drivers.ptp.test_shots import EXPOSURE, Bench, shot


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy")


@pytest.mark.parametrize(
    ("name", "handles"), [*((name, None) for name in PROFILES), ("nikon-z6", (0xFFFF0001, 0xFFFF0002))]
)
def test_a_camera_that_writes_raw_and_jpeg_gives_both_byte_for_byte(
    name: str,
    handles: tuple[int, int] | None,
    toy: SimulatedRig,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nikon's memory shows one file after the other under one handle, of some bodies both at once."""
    if handles is not None:
        monkeypatch.setattr(Nikon, "memory_handles", handles)
    monkeypatch.setitem(PROFILES, name, replace(PROFILES[name], jpeg=True))
    bench, sent = Bench(toy, name), list[bytes]()
    add = Store.add

    def stored(store: Store, photograph: Photograph, *args: object, **options: object) -> int:
        sent.append(photograph.data)
        return add(store, photograph, *args, **options)

    monkeypatch.setattr(Store, "add", stored)
    for number in range(2):
        frame = shot(bench.camera, EXPOSURE)
        assert isinstance(frame, CameraFile)
        raw, jpeg = sent[-2:]
        assert (frame.suffix, frame.data, frame.developed) == (".dng", raw, (".jpg", jpeg))
        assert len(sent) == 2 * (number + 1)


@pytest.mark.parametrize("name", PROFILES)
def test_a_jpeg_that_does_not_come_costs_no_shot(
    name: str, toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PROFILES, name, replace(PROFILES[name], jpeg=True))
    bench = Bench(toy, name)
    make = {
        "canon-eos-6d": CanonBody,
        "canon-eos-r7": CanonBody,
        "nikon-z6": NikonBody,
        "sony-a7m4": SonyBody,
    }.get(name, StandardBody)
    fetch = make.fetch

    def refused(body: StandardBody, file: Download) -> bytes:
        if file.info.filename.endswith(".JPG"):
            raise CameraProtocol("the card has it no more")
        return fetch(body, file)

    monkeypatch.setattr(make, "fetch", refused)
    frame = shot(bench.camera, EXPOSURE)
    assert isinstance(frame, CameraFile)
    assert frame.developed is None
    assert frame.suffix == ".dng"
    monkeypatch.undo()
    again = shot(bench.camera, EXPOSURE)
    assert isinstance(again, CameraFile)
    assert (again.suffix, again.developed is None) == (".dng", False)


@pytest.mark.parametrize("name", ["nikon-z6", "sony-a7m4"])
def test_a_jpeg_that_the_body_keeps_to_itself_costs_no_shot(
    name: str, toy: SimulatedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A body may be told to write both to its card and to send one."""
    monkeypatch.setitem(PROFILES, name, replace(PROFILES[name], jpeg=True))
    bench = Bench(toy, name)
    bench.camera.identify()
    bench.devices[0].responder.shooting.quality = PROFILES[name].raw_setting
    frame = shot(bench.camera, EXPOSURE)
    assert isinstance(frame, CameraFile)
    assert (frame.suffix, frame.developed) == (".dng", None)
    assert bench.clock.now() < 3.0


@pytest.mark.parametrize("name", ["nikon-z6", "sony-a7m4"])
def test_a_body_that_is_set_to_jpeg_is_set_to_raw(name: str, toy: SimulatedRig) -> None:
    bench = Bench(toy, name)
    responder = bench.devices[0].responder
    for quality in PROFILES[name].jpeg_settings:
        responder.properties.put(PropertyCode.COMPRESSION_SETTING, quality)
        responder.shooting.quality = quality
        camera = find_cameras(bench.bus, bench.clock)[0]
        frame = shot(camera, EXPOSURE)
        camera.close()
        assert isinstance(frame, CameraFile)
        assert (frame.suffix, frame.developed) == (".dng", None)


@pytest.mark.parametrize(
    ("body", "values", "nef"),
    [
        ("Z 6", range(14), 7),
        ("D7500", (0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12, 13), 7),
        ("Z 30", (0, 2, 4, 7, 8, 10, 12), 7),
        ("D3", range(8), 4),
        ("D750", (0, 1, 2, 4, 5, 6, 7), 4),
        ("D3200", (0, 1, 2, 4, 7), 4),
        ("D50", (0, 1, 2, 4, 5), 4),
        ("D200", range(7), 3),
        ("D40", range(5), 3),
        ("COOLPIX S9700", (0, 1, 2), None),
        ("COOLPIX P5000", (6, 12, 25), None),
    ],
)
def test_what_nikons_call_nef_follows_from_what_they_list(
    body: str, values: Iterable[int], nef: int | None
) -> None:
    """Lists of libgphoto2's dumps, meanings by its tables and, of the D200, by the seven of its menu."""
    assert nef_setting(tuple(values)) == nef
