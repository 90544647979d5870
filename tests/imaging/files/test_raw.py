"""RAW files: read exactly, or refused in one sentence."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from imaging.errors import InputError
from imaging.files.photo import read_metadata
from imaging.files.raw import is_raw, read_raw, read_raw_header, read_raw_metadata
from imaging.files.tiff.directory import BYTE, DOUBLE, LONG, RATIONAL, SHORT, SRATIONAL, Entry
from imaging.files.tiff.dng import encode_dng, write_dng
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from tests.imaging.files.damage import damaged

MakeRaw = Callable[..., RawMosaic]
Write = Callable[..., Path]

both_compressions = pytest.mark.parametrize("compression", ["none", "ljpeg"])


def one_sentence(error: pytest.ExceptionInfo[InputError], path: Path) -> bool:
    text = str(error.value)
    return text.startswith(str(path)) and text.endswith(".") and "\n" not in text and ": " in text


@both_compressions
@pytest.mark.parametrize(
    "area", [(0, 0, 96, 128), (2, 4, 90, 101), (1, 0, 96, 128), (0, 1, 96, 128), (3, 5, 91, 120)]
)
def test_the_active_area_shifts_phase_and_black(
    write: Write, make_raw: MakeRaw, area: tuple[int, int, int, int], compression: str
) -> None:
    # tags of an active area speak of its own corner
    raw = make_raw(96, 128, cfa=Cfa.GRBG)
    path = write(raw, compression, ACTIVE_AREA=Entry(LONG, area))
    top, left, bottom, right = area
    mosaic = read_raw(path)
    header = read_raw_header(path.read_bytes(), ".dng")
    assert (header.height, header.width) == mosaic.pixels.shape
    # LibRaw begins an active area with an odd corner one row or column later
    skipped = (top % 2, left % 2)
    rows, columns = slice(top + skipped[0], bottom), slice(left + skipped[1], right)
    height, width = raw.pixels[rows, columns].shape
    assert np.array_equal(
        mosaic.pixels, raw.pixels[rows, columns][: mosaic.pixels.shape[0], : mosaic.pixels.shape[1]]
    )
    assert (height - mosaic.pixels.shape[0], width - mosaic.pixels.shape[1]) in [
        (0, 0),
        (1, 0),
        (0, 1),
        (1, 1),
    ]
    expected = raw.cropped(*skipped, height, width)
    assert (mosaic.cfa, mosaic.black) == (expected.cfa, expected.black)


def test_a_crop_for_display_does_not_cut_the_mosaic(write: Write, make_raw: MakeRaw) -> None:
    path = write(CROP_ORIGIN=Entry(LONG, [4, 6]), CROP_SIZE=Entry(LONG, [32, 20]))
    assert np.array_equal(read_raw(path).pixels, make_raw().pixels)


def test_one_black_level_counts_for_all_sites(write: Write) -> None:
    path = write(BLACK_REPEAT=Entry(SHORT, [1, 1]), BLACK=Entry(SHORT, [128]))
    assert read_raw(path).black == ((128.0,) * 2,) * 2
    path = write(BLACK_REPEAT=None, BLACK=Entry(SHORT, [64]))
    assert read_raw(path).black == ((64.0,) * 2,) * 2
    path = write(BLACK_REPEAT=Entry(SHORT, [1, 2]), BLACK=Entry(SHORT, [10, 20]))
    assert read_raw(path).black == ((10.0, 20.0), (10.0, 20.0))
    path = write(BLACK_REPEAT=Entry(SHORT, [2, 1]), BLACK=Entry(SHORT, [10, 20]))
    assert read_raw(path).black == ((10.0, 10.0), (20.0, 20.0))
    path = write(BLACK_REPEAT=None, BLACK=None)
    assert read_raw(path).black == ((0.0,) * 2,) * 2


@pytest.mark.parametrize("repeat", [(4, 4), (1, 6), (6, 1), (3, 5)])
def test_black_levels_repeat_as_often_as_the_file_says(
    write: Write, make_raw: MakeRaw, repeat: tuple[int, int]
) -> None:
    levels = np.arange(100, 100 + np.prod(repeat)).reshape(repeat)
    # counted from the corner of the active area
    black = np.tile(levels, (40, 64))[:38, :61]
    pixels = np.full((40, 64), 7, np.uint16)
    pixels[2:, 3:] = black
    path = write(
        make_raw(pixels=pixels),
        BLACK_REPEAT=Entry(SHORT, repeat),
        BLACK=Entry(SHORT, levels.ravel().tolist()),
        ACTIVE_AREA=Entry(LONG, [2, 3, 40, 64]),
    )
    mosaic = read_raw(path)
    assert np.abs(mosaic.signal()).max() < 1e-6
    assert np.abs(mosaic.cropped(1, 3, 20, 30).signal()).max() < 1e-6
    assert np.mean(mosaic.black) == pytest.approx(mosaic.pixels.mean())


def test_black_deltas_of_rows_and_columns_are_added(write: Write, make_raw: MakeRaw) -> None:
    rows, columns = np.arange(40) - 20, np.arange(64) % 7
    pixels = (np.full((40, 64), 100) + rows[:, None] + columns).astype(np.uint16)
    deltas = {
        "BLACK_DELTA_H": Entry(SRATIONAL, columns.tolist()),
        "BLACK_DELTA_V": Entry(SRATIONAL, rows.tolist()),
    }
    one = {"BLACK_REPEAT": Entry(SHORT, [1, 1]), "BLACK": Entry(SHORT, [100])}
    mosaic = read_raw(write(make_raw(pixels=pixels), **one, **deltas))
    assert np.abs(mosaic.signal()).max() < 1e-6
    # one step for all is no pattern, and deltas of another size are none
    mosaic = read_raw(write(**one, BLACK_DELTA_V=Entry(SRATIONAL, [-4] * 40)))
    assert (mosaic.black, mosaic.black_offset) == (((96.0,) * 2,) * 2, None)
    mosaic = read_raw(write(**one, BLACK_DELTA_V=Entry(SRATIONAL, [-4] * 10)))
    assert (mosaic.black, mosaic.black_offset) == (((100.0,) * 2,) * 2, None)


def test_a_missing_white_level_is_the_largest_number(write: Write) -> None:
    assert read_raw(write(WHITE=None)).white == 65535


def test_the_green_noise_stands_for_all(write: Write) -> None:
    path = write(NOISE_PROFILE=Entry(DOUBLE, [1e-4, 1e-7, 2e-4, 2e-7, 3e-4, 3e-7]))
    assert read_raw(path).noise_profile == (2e-4, 2e-7)
    for useless in ([0.0, 0.0], [float("nan"), 1e-7], [1e-4, -1.0], [1e-4]):
        assert read_raw(write(NOISE_PROFILE=Entry(DOUBLE, useless))).noise_profile is None


def test_the_neutral_is_scaled_to_one(write: Write) -> None:
    assert read_raw(write(NEUTRAL=Entry(RATIONAL, [1, 4, 2]))).neutral == (0.25, 1.0, 0.5)


XTRANS = [
    1,
    1,
    0,
    1,
    1,
    2,
    1,
    1,
    2,
    1,
    1,
    0,
    2,
    0,
    1,
    0,
    2,
    1,
    1,
    1,
    2,
    1,
    1,
    0,
    1,
    1,
    0,
    1,
    1,
    2,
    0,
    2,
    1,
    2,
    0,
    1,
]


@pytest.mark.parametrize(
    "tags",
    [
        {"CFA_PATTERN": Entry(BYTE, [1, 1, 1, 1])},
        {"CFA_REPEAT": Entry(SHORT, [6, 6]), "CFA_PATTERN": Entry(BYTE, [3, *XTRANS[1:]])},
        {"CFA_REPEAT": Entry(SHORT, [4, 4]), "CFA_PATTERN": Entry(BYTE, [0, 0, 1, 1])},
        {"CFA_PATTERN": Entry(BYTE, [3, 4, 4, 5])},
        {"CFA_PLANES": Entry(BYTE, [3, 4, 5])},
        {"CFA_LAYOUT": Entry(SHORT, [2])},
    ],
    ids=["all green", "emerald", "short", "cmy", "cmy planes", "staggered"],
)
def test_what_is_no_mosaic_of_rgb_is_refused(write: Write, tags: dict[str, Entry]) -> None:
    path = write(**tags)
    with pytest.raises(
        InputError, match="has other filters than red, green and blue, and is not mono"
    ) as error:
        read_raw(path)
    assert one_sentence(error, path)


@pytest.mark.parametrize(("number", "name"), [(8, "deflate"), (34892, "lossy JPEG"), (52546, "JPEG XL")])
def test_a_compression_that_is_not_read_is_named(write: Write, number: int, name: str) -> None:
    path = write(COMPRESSION=Entry(SHORT, [number]))
    with pytest.raises(InputError, match=f"as {name}, which .*: convert it to an uncompressed") as error:
        read_raw(path)
    assert one_sentence(error, path)


@pytest.mark.parametrize(
    "tags",
    [
        {"COMPRESSION": Entry(SHORT, [777])},
        {"BLACK": Entry(SHORT, [5000, 0, 0, 0])},
        {"WHITE": Entry(LONG, [70000])},
        {"ACTIVE_AREA": Entry(LONG, [0, 0, 41, 64])},
        {"ACTIVE_AREA": Entry(LONG, [0, 0, 40, 59_000_000])},
        {"ACTIVE_AREA": Entry(LONG, [30, 0, 30, 64])},
        {"ACTIVE_AREA": Entry(LONG, [59_254_528, 256, 51_200, 59_256_832])},
        {"HEIGHT": Entry(LONG, [41])},
        {"ROWS_PER_STRIP": Entry(LONG, [10])},
    ],
)
def test_contradictions_are_refused(write: Write, tags: dict[str, Entry]) -> None:
    # the tags of the layout are merged before those of the colour
    path = write(**tags)
    with pytest.raises(InputError) as error:
        read_raw(path)
    assert one_sentence(error, path)


@both_compressions
def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path, make_raw: MakeRaw, compression: str) -> None:
    data = encode_dng(make_raw(), compression)
    path = tmp_path / "cut.dng"
    for end in [*range(0, 1400, 13), *range(1400, len(data) - 2, 391), len(data) - 2]:
        path.write_bytes(data[:end])
        with pytest.raises(InputError) as error:
            read_raw(path)
        assert one_sentence(error, path)


def test_zeros_at_the_end_are_refused(tmp_path: Path, make_raw: MakeRaw) -> None:
    # what a copy that broke off leaves on a file system that had reserved the space
    data = encode_dng(make_raw(), "ljpeg")
    path = tmp_path / "zeros.dng"
    for lost in (20, 500, 3000):
        path.write_bytes(data[:-lost] + bytes(lost))
        with pytest.raises(InputError, match="damaged or cut off"):
            read_raw(path)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("text.dng", b"hello, I am a text file\n" * 40, "not a DNG"),
        ("text.cr2", b"hello, I am a text file\n" * 40, "cannot be decoded"),
        ("empty.dng", b"", "is empty"),
        ("empty.nef", b"", "is empty"),
        ("zeros.dng", bytes(4096), "not a DNG"),
        ("zeros.raf", bytes(4096), "cannot be decoded"),
        ("short.dng", b"II*\0", "damaged or cut off"),
        ("loop.dng", b"II*\0\x08\0\0\0" + bytes(2) + b"\x08\0\0\0" + bytes(64), "cannot be decoded"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    for read in (read_raw, read_raw_metadata):
        if name == "loop.dng" and read is read_raw_metadata:
            continue
        with pytest.raises(InputError, match=says) as error:
            read(path)
        assert one_sentence(error, path)


def test_no_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_raw(tmp_path / "none.dng")
    (tmp_path / "folder.dng").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        read_raw(tmp_path / "folder.dng")


def test_nothing_is_printed(tmp_path: Path, make_raw: MakeRaw, capfd: pytest.CaptureFixture[str]) -> None:
    data = encode_dng(make_raw(), "ljpeg")
    path = tmp_path / "a.dng"
    for damage in (data[: len(data) // 2], data[:-3000] + bytes(3000), bytes(4000)):
        for suffix in (".dng", ".nef"):
            path.with_suffix(suffix).write_bytes(damage)
            with pytest.raises(InputError):
                read_raw(path.with_suffix(suffix))
    assert capfd.readouterr() == ("", "")


@both_compressions
def test_damaged_bytes_never_raise_anything_else(
    tmp_path_factory: pytest.TempPathFactory, make_raw: MakeRaw, compression: str
) -> None:
    path = tmp_path_factory.mktemp("damage") / "a.dng"
    data = encode_dng(make_raw(), compression)

    @settings(max_examples=250)
    @given(damaged(data, 900, 6))
    def damage(wrong: bytes) -> None:
        path.write_bytes(wrong)
        try:
            raw = read_raw(path)
        except InputError:
            return
        assert raw.pixels.ndim == 2
        assert raw.pixels.size > 0
        assert all(0 <= level < raw.white <= 65535 for row in raw.black for level in row)
        assert np.isfinite(raw.signal()).all()

    damage()


def test_metadata_needs_no_pixels(
    tmp_path: Path, make_raw: MakeRaw, metadata: FrameMetadata, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.dng"
    write_dng(path, make_raw())
    monkeypatch.delattr("rawpy.imread")
    assert read_metadata(path) == read_raw_metadata(path) == metadata


def test_suffixes() -> None:
    assert is_raw(Path("a/b.DNG"))
    assert is_raw(Path("b.cr3"))
    assert not is_raw(Path("b.jpg"))
    assert not is_raw(Path("dng"))


def test_a_real_dng(rig_data: Path) -> None:
    raw = read_raw(rig_data / "raw" / "colorchart.dng")
    assert raw.pixels.shape == (1156, 1734)
    assert raw.cfa == Cfa.RGGB
    assert raw.black == ((2056.0,) * 2,) * 2
    assert raw.white == 15000
    assert raw.neutral == pytest.approx((1 / 2.477, 1.0, 1.462 / 2.477), rel=1e-9)
    assert raw.camera_from_xyz == (
        (0.6461, -0.1164, -0.0857),
        (-0.3825, 1.1597, 0.2534),
        (-0.0416, 0.154, 0.6039),
    )
    assert raw.metadata.model == "Canon EOS Kiss X4"
    assert raw.metadata.exposure is None
    assert 0.0 < np.median(raw.signal()) < 1.0
