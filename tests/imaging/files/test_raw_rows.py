"""Mosaics with rows of two sensitivities are refused, and no scene is taken for one."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from imaging.errors import InputError
from imaging.files.raw import read_raw
from imaging.files.raw_rows import row_stops
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic

MakeRaw = Callable[..., RawMosaic]
Write = Callable[..., Path]
HEIGHT, WIDTH, BLACK, WHITE = 256, 384, 2048, 15000
Y, X = np.mgrid[:HEIGHT, :WIDTH]
SCENE = 0.02 + 0.1 * (1 + np.sin(X / 30) * np.cos(Y / 23))
SITES = np.where((Y % 2 == 0) & (X % 2 == 0), 0.5, np.where((Y % 2 == 1) & (X % 2 == 1), 0.6, 1.0))


def taken(electrons: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(1)
    noisy = BLACK + rng.poisson(electrons / 4) * 4 + rng.normal(0, 6, electrons.shape)
    return np.clip(noisy, 0, WHITE).astype(np.uint16)


def of(make_raw: MakeRaw, electrons: np.ndarray, cfa: Cfa = Cfa.RGGB) -> RawMosaic:
    return make_raw(pixels=taken(electrons), cfa=cfa, black=((float(BLACK),) * 2,) * 2, white=WHITE)


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(("gain", "light"), [(16, 2000), (4, 4000), (2, 4000), (16, 20000)])
def test_rows_of_two_sensitivities_are_refused(
    write: Write, make_raw: MakeRaw, first: int, gain: float, light: float
) -> None:
    by_turns = np.where(first == (Y // 2) % 2, 1, gain)
    path = write(of(make_raw, SCENE * SITES * light * by_turns))
    with pytest.raises(InputError, match=r"rows that differ by \d\.\d stops by turns") as error:
        read_raw(path)
    assert str(error.value).startswith(str(path))


def test_the_stops_are_told(make_raw: MakeRaw) -> None:
    raw = of(make_raw, SCENE * SITES * 2000 * np.where((Y // 2) % 2, 4, 1))
    assert row_stops(raw) == pytest.approx(2, abs=0.1)
    mono = of(make_raw, SCENE * 2000 * np.where(Y % 2, 4, 1), Cfa.MONO)
    assert row_stops(mono) == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize(
    "scene",
    [
        SCENE,
        np.full_like(SCENE, 0.001),
        np.full_like(SCENE, 30.0),
        np.random.default_rng(5).random(SCENE.shape),
        0.1 + 0.1 * (Y % 6 < 3),
        0.1 + 0.1 * (Y % 8 < 4),
        0.01 + Y / HEIGHT,
        np.where(Y < 100, SCENE * np.where((Y // 2) % 2, 4, 1), SCENE),
    ],
    ids=["smooth", "dark", "white", "noise", "stripes of 6", "stripes of 8", "ramp", "a blind"],
)
@pytest.mark.parametrize("cfa", [Cfa.RGGB, Cfa.MONO])
def test_no_scene_is_taken_for_that(make_raw: MakeRaw, scene: np.ndarray, cfa: Cfa) -> None:
    assert row_stops(of(make_raw, scene * (SITES if cfa.bayer else 1) * 4000, cfa)) == 0


def test_real_raw_files_have_rows_alike(rig_data: Path) -> None:
    assert row_stops(read_raw(rig_data / "raw" / "colorchart.dng")) == 0
