"""Focus and views of a camera: against rays through a lens, an Airy disc, and the edges of pictures."""

from math import inf, radians, tan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import curve_fit
from scipy.special import j1

from capture.rigfile.focus_plan import AIRY, F_NUMBERS, SHARP, TURN, focus_plan

LENS, WIDTH = (35.0, 3.76), 9504


def traced(lens: tuple[float, float], focus: float, distance: float, f_number: float) -> float:
    """Spread along one axis of rays from a point on the axis, photosites: refracted one by one."""
    focal, pitch = lens[0] * 1e-3, lens[1] * 1e-6
    sensor = focal * focus / (focus - focal)
    rng = np.random.default_rng(0)
    radius = 0.5 * focal / f_number * np.sqrt(rng.random(200_000))
    height = radius * np.cos(2 * np.pi * rng.random(radius.size))
    slope = height / distance - height / focal  # a thin lens bends by height / focal
    return float(np.std(height + sensor * slope) / pitch)


@pytest.mark.parametrize(("near", "far"), [(0.6, 1.4), (2.0, 40.0), (0.3, 0.31)])
def test_the_nearest_and_the_farthest_are_blurred_as_rays_are(near: float, far: float) -> None:
    plan = focus_plan(LENS, WIDTH, (near, far), 4.0)
    sharp = focus_plan(LENS, WIDTH, (plan.focus, plan.focus), 4.0)  # diffraction alone
    defocus = np.sqrt(plan.blur**2 - sharp.blur**2)
    for distance in (near, far):
        assert traced(LENS, plan.focus, distance, 4.0) == pytest.approx(defocus, rel=0.01)


def test_diffraction_is_the_gaussian_that_is_closest_to_an_airy_disc() -> None:
    radius = np.linspace(1e-6, 1.2, 400)  # wavelengths times the f-number: up to the first dark ring
    airy = (2 * j1(np.pi * radius) / (np.pi * radius)) ** 2
    (spread,), _ = curve_fit(lambda r, s: np.exp(-(r**2) / (2 * s**2)), radius, airy, 0.4)
    assert pytest.approx(spread, rel=0.02) == AIRY
    plan = focus_plan((50.0, 1.0), 100, (1e6, 1e6), 8.0)
    assert plan.blur == pytest.approx(AIRY * 0.55 * 8.0)


def test_an_infinite_subject_is_focused_at_twice_its_nearest() -> None:
    plan = focus_plan(LENS, WIDTH, (3.0, inf), 8.0)
    assert plan.focus == 6.0
    assert plan.around is None
    assert traced(LENS, 6.0, 1e9, 8.0) == pytest.approx(traced(LENS, 6.0, 3.0, 8.0), rel=0.01)


def test_the_lowest_f_number_that_is_sharp_is_advised_and_else_the_sharpest() -> None:
    """A higher one would only cost light."""
    flat = focus_plan(LENS, WIDTH, (3.0, 3.05), 8.0, (2.8, 4.0, 5.6))
    assert (flat.advised, flat.advised_width) == (2.8, WIDTH)
    deep = focus_plan(LENS, WIDTH, (0.6, 1.0), 2.8)
    others = [focus_plan(LENS, WIDTH, (0.6, 1.0), number).blur for number in F_NUMBERS]
    assert deep.advised_blur == min(others) > SHARP
    assert deep.blur > deep.advised_blur
    assert deep.advised_width == int(WIDTH * SHARP / deep.advised_blur)
    assert F_NUMBERS[0] < deep.advised < F_NUMBERS[-1]


def test_views_are_no_wider_apart_than_overlap_and_angle_allow() -> None:
    wide = focus_plan((8.0, 3.45), 2448, (1.0, 1.0), None)
    half = np.arctan(0.5 * wide.sees / 1.0)
    assert tan(half) == pytest.approx(0.5 * 2448 * 3.45e-3 / 8.0, rel=0.01)  # as focused at infinity, nearly
    assert wide.step == pytest.approx(wide.sees / 3)
    assert (wide.blur, wide.sharp_width) == (None, None)
    wider = focus_plan((2.0, 3.45), 2448, (1.0, 1.0), None)  # overlap alone would allow 1.4 m
    assert wider.step == pytest.approx(2 * np.sin(radians(TURN / 2)))
    assert wider.around == 12


def test_what_is_within_the_focal_length_cannot_be_focused() -> None:
    assert focus_plan((100.0, 4.0), 6000, (0.1, 1.0), 8.0) is None
    assert focus_plan((100.0, 4.0), 6000, (0.1001, 0.1001), 8.0) is not None


@given(
    st.tuples(st.floats(1e-3, 1e4), st.floats(1e-3, 1e4)),
    st.integers(1, 100_000),
    st.floats(1e-6, 1e9),
    st.floats(1.0, 1e6) | st.just(inf),
    st.none() | st.floats(0.1, 1e3),
)
def test_whatever_a_file_states_the_plan_is_finite(lens, width, near, deeper, f_number) -> None:
    plan = focus_plan(lens, width, (near, near * deeper), f_number)
    if plan is not None:
        numbers = [value for value in vars(plan).values() if value is not None]
        assert np.isfinite(numbers).all()
        assert plan.advised_width <= width
