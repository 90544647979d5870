"""CIEDE2000 against colour-science and the data that its authors published."""

import colour
import numpy as np
import pytest

from imaging.colour.difference import ciede2000, delta_e


def test_it_is_that_of_colour_science() -> None:
    rng = np.random.default_rng(0)
    one = rng.uniform([0, -100, -100], 100, (20_000, 3))
    other = one + rng.normal(0, 1, one.shape) * rng.uniform(0, 60, (len(one), 1))
    one[:50, 1:] = 0
    other[:25, 1:] = 0
    assert np.abs(ciede2000(one, other) - colour.delta_E(one, other, method="CIE 2000")).max() < 1e-9


@pytest.mark.parametrize(
    ("one", "other", "difference"),
    [
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, -1, 2), (50, 0, 0), 2.3669),
        ((50, 2.49, -0.001), (50, -2.49, 0.0009), 7.1792),
        ((50, 2.49, -0.001), (50, -2.49, 0.0011), 7.2195),
        ((50, 2.5, 0), (58, 24, 15), 19.4535),
        ((2.0776, 0.0795, -1.135), (0.9033, -0.0636, -0.5514), 0.9082),
    ],
)
def test_published_pairs(one, other, difference) -> None:
    """Sharma, Wu, Dalal 2005, table 1: rows 1, 7, 9, 11, 21 and 34, where programs go wrong."""
    assert ciede2000(one, other) == pytest.approx(difference, abs=5e-5)
    assert ciede2000(other, one) == pytest.approx(difference, abs=5e-5)


def test_white_against_black_is_a_hundred() -> None:
    assert delta_e([1.0, 1, 1], [0.0, 0, 0]) == pytest.approx(100, abs=1e-6)
