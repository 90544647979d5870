"""Tags of a DNG that move its samples or change what they mean: read as meant, or refused by their name."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile

from imaging.errors import InputError
from imaging.files.raw import read_raw
from imaging.files.tiff.directory import DOUBLE, RATIONAL, SHORT, UNDEFINED, Entry
from imaging.files.tiff.dng_pixels import in_place
from imaging.files.tiff.dng_unread import _BENDING
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic

MakeRaw = Callable[..., RawMosaic]
Write = Callable[..., Path]
TRUE = np.random.default_rng(2).integers(100, 4000, (64, 96), dtype=np.uint16)
LIGHT = np.random.default_rng(3).integers(200, 4000, (64, 96, 3), dtype=np.uint16)
COMMON = [(50706, 1, 4, b"\1\4\0\0", True), (50708, 2, 0, "Test", True)]
BAYER = [(33421, 3, 2, (2, 2), True), (33422, 1, 4, b"\0\1\1\2", True)]
FIELDS = [(50975, 3, 1, 2, True), (52547, 3, 1, 2, True)]


def fields(pixels: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The image as it is stored in so many fields."""
    return np.block([[pixels[r::rows, c::columns] for c in range(columns)] for r in range(rows)])


def put(path: Path, pixels: np.ndarray, tags: list[object], photometric: int, **options: object) -> Path:
    tifffile.imwrite(path, pixels, photometric=photometric, extratags=COMMON + tags, metadata=None, **options)
    return path


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 2), (2, 1), (1, 3), (3, 2), (5, 7)])
@pytest.mark.parametrize("shape", [(20, 24), (21, 25, 3)])
def test_fields_are_put_together(rows: int, columns: int, shape: tuple[int, ...]) -> None:
    image = np.arange(np.prod(shape)).reshape(shape)
    stored = np.concatenate([image[field::rows] for field in range(rows)])
    stored = np.concatenate([stored[:, field::columns] for field in range(columns)], axis=1)
    assert np.array_equal(in_place(stored, rows, columns), image)


@pytest.mark.parametrize("compression", [None, "jpegxl_dng", "deflate"])
def test_a_bayer_mosaic_in_fields_is_read_as_meant(tmp_path: Path, compression: str | None) -> None:
    path = put(tmp_path / "a.dng", fields(TRUE, 2, 2), BAYER + FIELDS, 32803, compression=compression)
    mosaic = read_raw(path)
    assert np.array_equal(mosaic.pixels, TRUE)
    assert mosaic.cfa == Cfa.RGGB
    plain = put(tmp_path / "b.dng", TRUE, BAYER, 32803, compression=compression)
    assert np.array_equal(read_raw(plain).pixels, TRUE)


@pytest.mark.parametrize("planes", [False, True])
def test_demosaicked_light_in_fields_and_in_planes(tmp_path: Path, planes: bool) -> None:
    stored = fields(LIGHT[..., 0], 2, 2)[..., None]
    stored = np.dstack([stored, *(fields(LIGHT[..., c], 2, 2) for c in (1, 2))])
    if planes:
        path = put(tmp_path / "a.dng", np.moveaxis(stored, -1, 0), FIELDS, 34892, planarconfig="separate")
    else:
        path = put(tmp_path / "a.dng", stored, FIELDS, 34892)
    assert np.array_equal(read_raw(path).pixels, LIGHT)


def test_more_fields_than_rows_are_damage(tmp_path: Path) -> None:
    path = put(tmp_path / "a.dng", TRUE, [*BAYER, (50975, 3, 1, 999, True)], 32803)
    with pytest.raises(InputError, match="cannot be decoded as RAW"):
        read_raw(path)


@pytest.mark.parametrize("samples", [1, 3])
def test_black_of_demosaicked_light_varies_as_its_tags_say(tmp_path: Path, samples: int) -> None:
    levels = np.arange(50, 50 + 4 * samples).reshape(2, 2, samples)
    rows, columns = np.arange(64) % 5, np.arange(96) % 3
    black = np.tile(levels, (32, 48, 3 // samples)) + rows[:, None, None] + columns[:, None]
    tags = [
        (50713, 3, 2, (2, 2), True),
        (50714, 3, 4 * samples, tuple(levels.ravel().tolist()), True),
        (50715, 10, 96, tuple(x for value in columns.tolist() for x in (value, 1)), True),
        (50716, 10, 64, tuple(x for value in rows.tolist() for x in (value, 1)), True),
        (50717, 4, 1, 4000, True),
    ]
    mosaic = read_raw(put(tmp_path / "a.dng", black.astype(np.uint16), tags, 34892))
    assert not mosaic.signal().any()
    mosaic = read_raw(put(tmp_path / "a.dng", (black + 1000).astype(np.uint16), tags, 34892))
    np.testing.assert_allclose(mosaic.signal(), 1000 / (4000 - black), rtol=5e-3)


def test_the_mosaic_is_neither_reduced_nor_enhanced(tmp_path: Path) -> None:
    enhanced = np.repeat(np.repeat(LIGHT, 2, 0), 2, 1)
    with tifffile.TiffWriter(tmp_path / "a.dng") as file:
        first = {"subfiletype": 1, "extratags": COMMON, "metadata": None}
        file.write(LIGHT[:8, :8].astype(np.uint8), photometric="rgb", subifds=2, **first)
        options = {"photometric": 34892, "metadata": None}
        file.write(enhanced, subfiletype=1, **options)
        file.write(LIGHT, subfiletype=0, **options)
    assert np.array_equal(read_raw(tmp_path / "a.dng").pixels, LIGHT)


def test_the_linear_part_of_the_range_ends_where_the_file_says(write: Write, make_raw: MakeRaw) -> None:
    raw = make_raw(black=((400.0,) * 2,) * 2)
    mosaic = read_raw(
        write(raw, LINEAR_LIMIT=Entry(RATIONAL, [1]), NOISE_PROFILE=Entry(DOUBLE, [1e-4, 1e-6]))
    )
    less = read_raw(
        write(raw, LINEAR_LIMIT=Entry(RATIONAL, [0.75]), NOISE_PROFILE=Entry(DOUBLE, [1e-4, 1e-6]))
    )
    assert (mosaic.white, less.white) == (4000, 3100)
    assert mosaic.noise is not None
    assert less.noise is not None
    for level in (500.0, 2000.0):
        assert less.noise.variance(level) == pytest.approx(mosaic.noise.variance(level))


def test_a_linearization_table_is_applied(write: Write, make_raw: MakeRaw) -> None:
    table = np.rint(np.linspace(0, 1, 4001) ** 2 * 4000).astype(int)
    raw = make_raw(black=((0.0,) * 2,) * 2)
    mosaic = read_raw(write(raw, LINEARIZATION=Entry(SHORT, table.tolist())))
    assert np.array_equal(mosaic.pixels, table[raw.pixels])


def opcodes(*numbers: int) -> Entry:
    """A list of opcodes without their parameters, big-endian as the specification has it."""
    items = b"".join(struct.pack(">4I", number, 0x01030000, 0, 8) + bytes(8) for number in numbers)
    return Entry(UNDEFINED, struct.pack(">I", len(numbers)) + items)


@pytest.mark.parametrize("number", _BENDING)
@pytest.mark.parametrize("name", ["OpcodeList1", "OpcodeList2", "OpcodeList3"])
def test_an_opcode_that_bends_the_response_is_refused(
    write: Write, monkeypatch: pytest.MonkeyPatch, number: int, name: str
) -> None:
    tag = {"OpcodeList1": 51008, "OpcodeList2": 51009, "OpcodeList3": 51022}[name]
    monkeypatch.setattr("imaging.files.tiff.dng_tags.BASELINE_NOISE", tag)
    path = write(BASELINE_NOISE=opcodes(9, number))
    with pytest.raises(InputError, match=f"asks for {_BENDING[number]} in its {name}") as error:
        read_raw(path)
    assert str(error.value).startswith(str(path))


def test_opcodes_that_correct_a_lens_or_a_defect_change_nothing(
    write: Write, make_raw: MakeRaw, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imaging.files.tiff.dng_tags.BASELINE_NOISE", 51009)
    for entry in (opcodes(1, 2, 3, 4, 5, 9), Entry(UNDEFINED, b"\0\0\0\x09abc"), Entry(UNDEFINED, b"")):
        assert np.array_equal(read_raw(write(BASELINE_NOISE=entry)).pixels, make_raw().pixels)


@pytest.mark.parametrize(
    ("tag", "entry", "named"),
    [
        (339, Entry(SHORT, [3]), "floating-point samples .SampleFormat 3"),
        (339, Entry(SHORT, [2]), "signed samples .SampleFormat 2"),
        (50974, Entry(SHORT, [2, 2]), "SubTileBlockSize"),
        (50879, Entry(SHORT, [1]), "ColorimetricReference"),
        (50879, Entry(SHORT, [2]), "ColorimetricReference"),
    ],
)
def test_samples_of_another_meaning_are_refused_by_their_tag(
    write: Write, monkeypatch: pytest.MonkeyPatch, tag: int, entry: Entry, named: str
) -> None:
    monkeypatch.setattr("imaging.files.tiff.dng_tags.BASELINE_SHARPNESS", tag)
    path = write(BASELINE_SHARPNESS=entry)
    with pytest.raises(InputError, match=named) as error:
        read_raw(path)
    text = str(error.value)
    assert text.startswith(str(path))
    assert text.endswith(".")
    assert "\n" not in text


def test_a_field_of_a_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.dng holds every other row of a picture \(Interlace\): convert"):
        read_raw(put(tmp_path / "a.dng", TRUE, [*BAYER, (34857, 3, 1, 1, True)], 32803))
    assert np.array_equal(
        read_raw(put(tmp_path / "b.dng", TRUE, [*BAYER, (34857, 3, 1, 0, True)], 32803)).pixels, TRUE
    )
