"""Files that claim more than the machine has, and what it has."""

import json
import re
import resource
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile

from imaging.compute import memory
from imaging.errors import InputError
from imaging.files.photo import encode_jpeg, encode_png
from imaging.files.tiff.directory import BYTE, Entry, TiffError, TiffReader, encode_directory
from imaging.files.tiff.dng import encode_dng
from imaging.sensor.mosaic import RawMosaic

HEADROOM = 1 << 30
"""Bytes beyond its libraries that the reading process has."""

READER = """
import json, resource, sys, time
from pathlib import Path
from capture.imports.layouts.llff import read_rows
from capture.imports.layouts.ply_points import read_ply_points
from capture.pictures.read import read_picture
from imaging.files import exr, raw
from imaging.errors import InputError
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + int(sys.argv[2]),) * 2)
readers = {".ply": read_ply_points, ".npy": lambda path: read_rows(path, 17)}
told = {}
for path in sorted(Path(sys.argv[1]).iterdir()):
    began = time.process_time()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        readers.get(path.suffix, read_picture)(path)
        said = "read"
    except InputError as error:
        said = str(error)
    taken = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    told[path.name] = [said, taken / 1024, time.process_time() - began]
print(json.dumps(told))
"""


def exr(
    window: str, corner: tuple[int, int], tile: tuple[int, int] | None = None, channels: str = "Y"
) -> bytes:
    """A file of a few pixels with another corner of a window, or another size of its tiles."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if tile is not None:
        header = {
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.tiledimage,
            "tiles": OpenEXR.TileDescription(),
        }
    buffer = BytesIO()
    OpenEXR.File(header, {name: np.ones((40, 40), np.float32) for name in channels}).write(buffer)
    data = bytearray(buffer.getvalue())
    place = data.index(name := f"{window}\0box2i\0".encode()) + len(name) + 4
    data[place : place + 16] = struct.pack("<4i", 0, 0, *corner)
    if tile is not None:
        place = data.index(name := b"tiles\0tiledesc\0") + len(name) + 4
        data[place : place + 8] = struct.pack("<2I", *tile)
    return bytes(data)


def png(width: int, height: int, *, whole: bool = True) -> bytes:
    """One bit a pixel, all black; without its pixels unless whole."""
    packed = zlib.compressobj(9)
    row = bytes(1 + -(-width // 8))
    pixels = b"".join(packed.compress(row) for _ in range(height if whole else 1)) + packed.flush()

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    data = bytearray(encode_jpeg(np.zeros((16, 16), np.uint8)))
    place = data.index(b"\xff\xc0") + 5
    data[place : place + 4] = struct.pack(">HH", height, width)
    return bytes(data)


def tiff(width: int, height: int, **options: object) -> bytes:
    buffer = BytesIO()
    tifffile.imwrite(buffer, np.zeros((64, 64, 3), np.uint8), photometric="rgb", **options)
    data = buffer.getvalue()
    for tag, old, new in ((256, 64, width), (257, 64, height), (278, 64, height)):
        for kind, form in ((3, "HH"), (4, "I")):
            before = struct.pack("<HHI", tag, kind, 1) + struct.pack(
                f"<{form}", *([old, 0] if kind == 3 else [old])
            )
            data = data.replace(before, struct.pack("<HHII", tag, 4, 1, new))
    return data


def npy(shape: tuple[int, ...]) -> bytes:
    buffer = BytesIO()
    np.save(buffer, np.zeros((2, 18)))
    return buffer.getvalue().replace(b"(2, 18), }" + b" " * 20, f"{shape}, }}".ljust(30).encode())


PLY = b"""ply
format ascii 1.0
element vertex %d
property float x
property float y
property float z
end_header
"""

TAKES = "has 20000x10000 pixels, which takes"

BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    "display.exr": (lambda: exr("displayWindow", (39_999, 39_999)), "claims 40000x40000 pixels"),
    "display-fits.exr": (
        lambda: exr("displayWindow", (19_999, 9_999)),
        "has 20000x10000 pixels, which takes",
    ),
    "data.exr": (lambda: exr("dataWindow", (19_999, 9_999)), TAKES),
    "channels.exr": (
        lambda: exr("dataWindow", (3_999, 1_999), channels="RGBAXYZ"),
        "has 4000x2000 pixels",
    ),
    "tile.exr": (lambda: exr("displayWindow", (39, 39), tile=(32, 11_010_080)), "is damaged"),
    "tiles.exr": (lambda: exr("dataWindow", (15_999, 15_999), tile=(1, 1)), "has 16000x16000 pixels"),
    "real.png": (lambda: png(16_384, 8_192), "has 16384x8192 pixels, which takes"),
    "false.png": (lambda: png(30_000, 10_000, whole=False), "is damaged"),
    "endless.png": (lambda: png(2**31 - 1, 2**31 - 1, whole=False), "is damaged"),
    "a.jpg": (lambda: jpeg(65_500, 65_500), "claims 65500x65500 pixels"),
    "fits.jpg": (lambda: jpeg(20_000, 10_000), TAKES),
    "strip.tif": (lambda: tiff(20_000, 10_000, compression="deflate"), TAKES),
    "a.ply": (lambda: PLY % 900_000 + b"1 " * 900_000, "is not a PLY file of points|takes"),
    "count.ply": (lambda: PLY % 10**12, "is not a PLY file of points"),
    "a.npy": (lambda: npy((10**9, 18)), "cannot be read as an array"),
}


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, float, float]]:
    """Report of a process with little memory on every file, with MB and seconds of each."""
    folder = tmp_path_factory.mktemp("bombs")
    for name, (data, _) in BOMBS.items():
        (folder / name).write_bytes(data())
        assert (folder / name).stat().st_size < 2_500_000
    done = subprocess.run(
        [sys.executable, "-c", READER, str(folder), str(HEADROOM)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return {name: tuple(values) for name, values in json.loads(done.stdout).items()}


@pytest.mark.parametrize("name", BOMBS)
def test_a_file_that_claims_more_than_there_is_is_refused_before_it_is_taken(
    refusals: dict[str, tuple[str, float, float]], name: str
) -> None:
    said, megabytes, seconds = refusals[name]
    assert re.search(BOMBS[name][1], said), said
    assert said.endswith(".")
    assert "\n" not in said
    assert megabytes < 200
    assert seconds < 5


def test_a_dng_larger_than_the_memory_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from imaging.files.raw import read_raw
    from imaging.sensor.cfa import Cfa

    pixels = np.zeros((64, 64), np.uint16)
    (tmp_path / "a.dng").write_bytes(encode_dng(RawMosaic(pixels, Cfa.RGGB, ((0.0,),), 4095)))
    assert read_raw(tmp_path / "a.dng").pixels.shape == (64, 64)
    monkeypatch.setattr(memory, "UNASKED", 0)
    monkeypatch.setattr(memory, "available", lambda: 100_000)
    with pytest.raises(InputError, match=r"has 64x64 pixels, which takes 0 MB of memory where 0 MB are free"):
        read_raw(tmp_path / "a.dng")


def test_tags_that_share_their_value_do_not_multiply_it() -> None:
    value = b"\1" * (1 << 16)
    data = b"II*\0\x08\0\0\0" + encode_directory({700: Entry(BYTE, value)}, 8)
    count, entry = 2_000, data[10:22]
    table = struct.pack("<H", count) + entry * count + bytes(4)
    data = data[:4] + struct.pack("<I", len(data)) + data[8:] + table
    with pytest.raises(TiffError, match="more values than bytes"):
        TiffReader(BytesIO(data)).directories()


def test_what_is_free_is_the_least_that_anyone_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "meminfo").write_text("MemTotal: 9000 kB\nMemAvailable: 5000 kB\n")
    monkeypatch.setattr(memory, "_MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_GROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(memory, "_OWN_GROUPS", tmp_path / "own")
    assert memory.available() == 5000 * 1024
    for version, (limit, usage) in {
        "": ("memory.max", "memory.current"),
        "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes"),
    }.items():
        group = tmp_path / "cgroup" / version / "box" / "a"
        group.mkdir(parents=True)
        (group / limit).write_text("4000000\n")
        (group / usage).write_text("1500000\n")
        (group / "memory.stat").write_text("anon 1\ninactive_file 500000\n")
        (tmp_path / "own").write_text(f"4:{version}:/box/a\n1:cpu:/\n")
        assert memory.available() == 3_000_000
        (group / limit).write_text("max\n")
        assert memory.available() == 5000 * 1024
        for name, value in ((limit, "2000000"), (usage, "500000"), ("memory.stat", "inactive_file 0")):
            (group.parent / name).write_text(f"{value}\n")
        assert memory.available() == 1_500_000  # of the group around it
        (group.parent / limit).unlink()
    (tmp_path / "meminfo").write_text("")
    assert memory.available() > 0


def test_a_limit_of_the_address_space_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    before = memory.available()
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    monkeypatch.setattr(resource, "getrlimit", lambda _: (used + 10_000_000, used + 10_000_000))
    assert 0 < memory.available() <= min(before + 10**9, 10_000_000)


@pytest.mark.parametrize(("width", "height"), [(0, 5), (-3, 5), (1 << 20, 1 << 20)])
def test_sizes_that_no_picture_has_are_refused(width: int, height: int) -> None:
    with pytest.raises(InputError, match=r"^a\.exr (is damaged, since it )?claims .*: copy it again.*\.$"):
        memory.check_picture("a.exr", width, height)


def test_what_fits_is_let_through() -> None:
    memory.check_picture("a.png", 1000, 1000)
    assert encode_png(np.zeros((2, 2), np.uint8))


def test_a_share_of_the_machine_bounds_what_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    """Less what this process has of it already."""
    monkeypatch.setenv(memory.GIVEN, str(memory.resident() + (100 << 20)))
    assert memory.available() == pytest.approx(100 << 20, abs=8 << 20)
    monkeypatch.setenv(memory.GIVEN, "1")
    assert memory.available() == 0
