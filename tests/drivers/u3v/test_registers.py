"""The manifest: raw and zipped XML, the newest entry, and damage of every kind."""

import hashlib
import io
import zipfile
from dataclasses import replace

import pytest

from drivers.errors import CameraProtocol
from drivers.u3v.registers import ManifestEntry, read_xml

from .test_control import Scripted, opened

XML = b"<RegisterDescription/>" * 20


def archive(data: bytes = XML) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("camera.xml", data)
    return buffer.getvalue()


def entry(
    data: bytes, zipped: bool, address: int = 0x400, version: tuple[int, int, int] = (1, 0, 0)
) -> ManifestEntry:
    return ManifestEntry(version, zipped, address, len(data), hashlib.sha1(data).digest())


def read(*contents: tuple[ManifestEntry, bytes], count: int | None = None) -> bytes:
    device = Scripted()
    device.memory[:8] = (len(contents) if count is None else count).to_bytes(8, "little")
    for index, (one, data) in enumerate(contents):
        device.memory[8 + 64 * index : 72 + 64 * index] = one.pack()
        device.memory[one.address : one.address + len(data)] = data
    return read_xml(opened(device)[0], 0)


def test_an_entry_byte_by_byte() -> None:
    packed = ManifestEntry((2, 3, 0x104), True, 0x100000, 0x2000, bytes(range(20))).pack()
    assert packed[:24].hex(" ") == "04 01 03 02 00 04 00 00 00 00 10 00 00 00 00 00 00 20 00 00 00 00 00 00"
    assert packed[24:] == bytes(range(20)) + bytes(20)
    assert ManifestEntry.parse(packed).version == (2, 3, 0x104)
    assert ManifestEntry.parse(packed).pack() == packed


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("hashed", [False, True])
def test_raw_and_zipped(zipped: bool, hashed: bool) -> None:
    data = archive() if zipped else XML
    one = entry(data, zipped)
    assert read((one if hashed else replace(one, sha1=bytes(20)), data)) == XML


def test_the_newest_entry_counts() -> None:
    older = (entry(b"<old/>", False, 0x400, (1, 9, 9)), b"<old/>")
    newer = (entry(XML, False, 0x800, (2, 0, 0)), XML)
    assert read(older, newer) == XML == read(newer, older)


def test_another_hash_is_refused() -> None:
    damaged = XML[:-1] + b"!"
    with pytest.raises(CameraProtocol, match="SHA-1"):
        read((entry(XML, False), damaged))


@pytest.mark.parametrize(
    "data",
    [b"no archive", archive()[:-30], archive()[:40] + bytes(30) + archive()[70:], b"PK\5\6" + bytes(18)],
)
def test_a_broken_archive_is_refused(data: bytes) -> None:
    with pytest.raises(CameraProtocol, match="cannot be unzipped"):
        read((replace(entry(data, True), sha1=bytes(20)), data))


@pytest.mark.parametrize("count", [0, 65, 2**63])
def test_a_senseless_count_is_refused(count: int) -> None:
    with pytest.raises(CameraProtocol, match=f"{count} entries"):
        read((entry(XML, False), XML), count=count)


def test_a_senseless_size_is_refused() -> None:
    with pytest.raises(CameraProtocol, match="bytes"):
        read((replace(entry(XML, False), size=1 << 40), XML))


def test_an_archive_that_would_fill_the_memory_is_refused() -> None:
    data = archive(bytes(40 << 20))
    device = Scripted()
    device.memory = bytearray(0x400 + len(data))
    device.memory[:8] = (1).to_bytes(8, "little")
    device.memory[8:72] = entry(data, True).pack()
    device.memory[0x400:] = data
    channel, _ = opened(device)
    channel.limit(60000, 60000, 0.5)
    with pytest.raises(CameraProtocol, match="unzips to"):
        read_xml(channel, 0)
