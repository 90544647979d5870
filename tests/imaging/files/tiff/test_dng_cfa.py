"""DNG of colour filter arrays beyond Bayer's, and of none."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rawpy
import tifffile

from imaging.files.raw import read_raw
from imaging.files.tiff.dng import write_dng
from imaging.sensor.cfa import Cfa, as_tile
from imaging.sensor.mosaic import RawMosaic, as_matrix

from ..exiftool import exiftool, needs_exiftool

MakeRaw = Callable[..., RawMosaic]

TABLES = [Cfa.X_TRANS, Cfa.QUAD_BAYER, Cfa.KODAK_RGBW, Cfa.MONO, Cfa.of("RG/BG")]
other_tables = pytest.mark.parametrize("cfa", TABLES)
both_compressions = pytest.mark.parametrize("compression", ["none", "ljpeg"])


def of_table(make_raw: MakeRaw, cfa: Cfa, height: int = 40, width: int = 64) -> RawMosaic:
    """A mosaic whose colours have as many channels as its table, each site with a black of its own."""
    rows, channels = np.arange(1.0, 13.0).reshape(4, 3), len(cfa.letters)
    return make_raw(
        height,
        width,
        cfa=cfa,
        black=as_tile(256.0 + np.arange(np.prod(cfa.tile)).reshape(cfa.tile) / 4),
        neutral=None
        if cfa.mono
        else (0.5, 0.75, 0.625, 1.0)[:channels]
        if channels == 4
        else (0.5, 1.0, 0.75),
        camera_from_xyz=None if cfa.mono else as_matrix(rows[:channels]),
    )


@both_compressions
@other_tables
def test_any_table_comes_back_as_written(
    tmp_path: Path, make_raw: MakeRaw, cfa: Cfa, compression: str
) -> None:
    raw = of_table(make_raw, cfa, 41, 65)
    write_dng(tmp_path / "a.dng", raw, compression=compression)
    back = read_raw(tmp_path / "a.dng")
    assert np.array_equal(back.pixels, raw.pixels)
    assert replace(back, pixels=raw.pixels) == raw
    assert np.array_equal(tifffile.imread(tmp_path / "a.dng"), raw.pixels)


def test_libraw_sees_x_trans_and_mono_as_written(tmp_path: Path, make_raw: MakeRaw) -> None:
    for cfa in (Cfa.X_TRANS, Cfa.X_TRANS.cropped(2, 1), Cfa.MONO):
        raw = of_table(make_raw, cfa)
        write_dng(tmp_path / "a.dng", raw)
        with rawpy.imread(str(tmp_path / "a.dng")) as opened:
            assert np.array_equal(opened.raw_image_visible, raw.pixels)
            if not cfa.mono:
                letters = np.array(list(opened.color_desc.decode()))[opened.raw_colors_visible[:6, :6]]
                assert tuple("".join(row) for row in letters) == cfa.rows


@needs_exiftool
@other_tables
def test_exiftool_reads_any_table_as_meant(tmp_path: Path, make_raw: MakeRaw, cfa: Cfa) -> None:
    write_dng(tmp_path / "a.dng", of_table(make_raw, cfa))
    tags = exiftool(tmp_path / "a.dng", "-n", "-a", "-validate", "-warning", "-error", "-CFA*", "-Photo*")
    assert tags["Validate"] == "0 0 0"
    if cfa.mono:
        assert tags["PhotometricInterpretation"] == 34892
    else:
        assert tags["CFARepeatPatternDim"] == "{} {}".format(*cfa.period)
        codes = [{"R": 0, "G": 1, "B": 2, "W": 6}[letter] for row in cfa.rows for letter in row]
        assert tags["CFAPattern2"] == " ".join(map(str, codes))
