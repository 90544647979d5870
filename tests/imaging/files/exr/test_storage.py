"""Light that an EXR stores smaller: what another reader takes from the file, and how far that is off."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from imaging.choices import ExrStorage
from imaging.errors import InputError
from imaging.files.exr.reading import read_exr
from imaging.files.exr.writing import write_exr

DEPTH = np.random.default_rng(1).uniform(1, 1e6, (96, 128)).astype(np.float32)


def light() -> np.ndarray:
    """Fourteen stops from left to right in three hues, with noise of 1 %."""
    ramp = 2.0 ** np.linspace(-8, 6, 128)[None, :, None] * np.array([1.0, 0.7, 0.4])
    return (ramp * np.random.default_rng(2).normal(1, 0.01, (96, 128, 3))).astype(np.float32)


@pytest.mark.parametrize(
    ("storage", "kind", "compression", "median", "worst"),
    [
        ("float", np.float32, OpenEXR.ZIP_COMPRESSION, 0.0, 0.0),
        ("half", np.float16, OpenEXR.ZIP_COMPRESSION, 0.0004, 2**-11 / np.log(2) * 1.01),
        ("dwaa", np.float16, OpenEXR.DWAA_COMPRESSION, 0.02, 0.12),
    ],
)
def test_the_library_reads_the_light_as_it_is_stated_and_data_without_loss(
    storage: ExrStorage, kind: type, compression: object, median: float, worst: float, tmp_path: Path
) -> None:
    """Errors in stops."""
    write_exr(tmp_path / "a.exr", light(), storage=storage, data={"depth": {"Z": DEPTH}})
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        first, second = file.parts
        assert first.header["compression"] == compression
        assert first.channels["R"].pixels.dtype == kind
        stored = np.stack([first.channels[name].pixels.astype(float) for name in "RGB"], axis=-1)
        assert second.header["compression"] == OpenEXR.ZIP_COMPRESSION
        assert np.array_equal(second.channels["Z"].pixels, DEPTH)
    off = np.abs(np.log2(stored / light()))
    assert np.median(off) <= median
    assert off.max() <= worst
    assert np.array_equal(read_exr(tmp_path / "a.exr").rgb(), stored.astype(np.float32))


def test_each_storage_is_smaller_than_the_one_before(tmp_path: Path) -> None:
    storages: tuple[ExrStorage, ...] = ("float", "half", "dwaa")
    sizes = []
    for storage in storages:
        write_exr(tmp_path / "a.exr", light(), storage=storage)
        sizes.append((tmp_path / "a.exr").stat().st_size)
    assert sizes[1] < 0.5 * sizes[0]
    assert sizes[2] < 0.5 * sizes[1]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_dwaa_would_make_zero_is_refused(value: float, tmp_path: Path) -> None:
    pixels = light()
    pixels[3, 4, 1] = value
    with pytest.raises(InputError, match=r"channel G has NaN or infinity.*half\.$"):
        write_exr(tmp_path / "a.exr", pixels, storage="dwaa")
    assert not list(tmp_path.iterdir())
