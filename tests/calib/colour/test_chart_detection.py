"""A chart is found where it was painted, measured as it was painted, and refused where it is none."""

from pathlib import Path

import numpy as np
import pytest

from calib.colour.chart_detection import DetectedChart, Missed, best, judge, locate, measure_patches
from calib.colour.chart_values import chart
from calib.colour.fit import ChartPatches, ColourModel, held_out, of_camera
from imaging.colour.spaces import camera_from_rec709
from imaging.files.raw import read_raw
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.linear_frame import from_raw
from imaging.sensor.cfa import Cfa, cell_means

from .charts import painted, photograph, square_on, world

WIDTH, HEIGHT = 720, 480
NIKON = world("nikon", "D65")


def view(corners: np.ndarray, exposure: float = 0.8, **how) -> Merged:
    light = painted(NIKON.camera, NIKON.white, corners, WIDTH, HEIGHT)
    return merge_bracket([from_raw(photograph(light, exposure / light.max(), **how), 1.0)])


def found_in(merged: Merged) -> DetectedChart | Missed:
    assert merged.cfa is not None
    return best(merged, [2 * outlines for outlines in locate(cell_means(merged.radiance, merged.cfa))])


@pytest.mark.parametrize(
    ("share", "turn", "tilt", "exposure", "cfa"),
    [
        (0.5, 0, 0, 0.8, Cfa.RGGB),
        (0.3, 25, 0.5, 0.8, Cfa.BGGR),
        (0.5, 180, 0, 0.1, Cfa.GRBG),
        (0.6, 90, 1.0, 0.02, Cfa.GBRG),
    ],
)
def test_patches_measure_what_was_painted(
    share: float, turn: float, tilt: float, exposure: float, cfa: Cfa
) -> None:
    located = found_in(view(square_on(WIDTH, HEIGHT, share, turn, tilt), exposure, cfa=cfa))
    assert isinstance(located, DetectedChart)
    patches = located.patches
    assert patches.usable.sum() >= 22
    ratio = (patches.rgb / NIKON.camera)[patches.usable]
    scale = np.median(ratio)
    sigma = (patches.sigma / NIKON.camera)[patches.usable] / scale
    assert np.all(np.abs(ratio / scale - 1) < 0.005 + 5 * sigma)
    assert np.abs(patches.place).max() == pytest.approx(1.0)


def test_vignetting_that_is_known_is_divided_out() -> None:
    merged = view(square_on(WIDTH, HEIGHT, 0.9), vignetting=-0.4)
    assert merged.cfa is not None
    (outlines, *_) = (2 * one for one in locate(cell_means(merged.radiance, merged.cfa)))
    bare, flat = measure_patches(merged, outlines), measure_patches(merged, outlines, (-0.4, 0.0, 0.0))
    both = bare.usable & flat.usable
    spread = [np.ptp(np.log((one.rgb / NIKON.camera)[both][:, 1])) for one in (bare, flat)]
    assert spread[0] > 0.1
    assert spread[1] < 0.03


def test_clipped_and_shaded_patches_are_left_out() -> None:
    corners = square_on(WIDTH, HEIGHT, 0.5)
    light = painted(NIKON.camera, NIKON.white, corners, WIDTH, HEIGHT)
    # The edge of a shadow runs through the middle of the fourth column.
    light[:, 389:] *= 0.5
    located = found_in(merge_bracket([from_raw(photograph(light, 1.25 / light.max()), 1.0)]))
    assert isinstance(located, DetectedChart)
    assert not located.patches.usable[[3, 9, 15, 21]].any()
    bright = found_in(view(corners, 1.3))
    assert isinstance(bright, DetectedChart)
    assert not bright.patches.usable[18]
    assert bright.patches.usable[[0, 21, 22]].all()


def test_a_wall_is_no_chart() -> None:
    random = np.random.default_rng(3)
    texture = np.repeat(np.repeat(random.uniform(0.05, 1, (12, 18, 3)), 40, 0), 40, 1)
    verdict = found_in(merge_bracket([from_raw(photograph(texture, 0.8), 1.0)]))
    assert isinstance(verdict, Missed)


def test_a_chart_in_a_mirror_is_measured_and_one_of_other_colours_refused() -> None:
    corners = square_on(WIDTH, HEIGHT, 0.5)
    located = found_in(view(corners[[1, 0, 3, 2]]))
    assert isinstance(located, DetectedChart)
    ratio = (located.patches.rgb / NIKON.camera)[located.patches.usable]
    assert np.ptp(np.log(ratio)) < 0.05
    other = painted(NIKON.camera[[*range(17, -1, -1), *range(18, 24)]], NIKON.white, corners, WIDTH, HEIGHT)
    verdict = found_in(merge_bracket([from_raw(photograph(other, 0.8 / other.max()), 1.0)]))
    assert isinstance(verdict, Missed)


def test_a_real_chart_is_found_and_fitted(real: Path) -> None:
    """A folding chart with other patches above, out of focus, lit from behind by a window."""
    raw = read_raw(real / "raw" / "colorchart.dng")
    assert raw.camera_from_xyz is not None
    located = found_in(merge_bracket([from_raw(raw, 1.0)]))
    assert isinstance(located, DetectedChart)
    centre = located.outlines.mean(axis=(0, 1))
    assert centre == pytest.approx((983, 777), abs=30)
    assert located.patches.usable.sum() >= 20
    files = of_camera(camera_from_rec709(raw.camera_from_xyz), balanced=True)
    chosen, stated = (
        np.nanmean(held_out([located.patches], chart(), one)[0]) for one in (ColourModel(), files)
    )
    assert chosen < 4.0
    assert chosen < stated - 1.0


def judged(rgb: np.ndarray, usable: np.ndarray | None = None) -> DetectedChart | Missed:
    everywhere = np.ones(24, bool) if usable is None else usable
    row, column = np.divmod(np.arange(24), 6)
    place = np.stack([column / 2.5 - 1, row / 1.5 - 1], axis=1)
    return judge(ChartPatches(rgb, 0.001 * rgb, place, everywhere), np.zeros((24, 4, 2)))


def test_what_a_find_is_believed_by() -> None:
    assert isinstance(judged(chart()), DetectedChart)
    few = np.zeros(24, bool)
    few[13:] = True
    verdict = judged(chart(), few)
    assert isinstance(verdict, Missed)
    assert "only 11 of 24 patches" in verdict.reason
    verdict = judged(chart()[[*range(18), *range(23, 17, -1)]])
    assert isinstance(verdict, Missed)
    assert "do not fall from white to black" in verdict.reason
    verdict = judged(chart()[[*range(17, -1, -1), *range(18, 24)]])
    assert isinstance(verdict, Missed)
    assert "are not the chart's" in verdict.reason
