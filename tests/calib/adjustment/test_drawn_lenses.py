"""How far drawn lenses go, and which of their terms are doubtful."""

import numpy as np

from calib.adjustment.drawn_lenses import bounded, weak_terms
from imaging.session.records import ONE_OF_SEVERAL, Rung


def rung(name: str, gain: float, errors: float = ONE_OF_SEVERAL) -> Rung:
    return Rung.judged(name, gain, 1.0, "", "", errors=errors)


def test_no_term_spreads_farther_than_its_prior_and_the_rest_follows() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    curvature = root @ root.T + np.eye(6)
    moves = rng.normal(size=(100, 6)) * np.array([1, 1, 1, 1, 40, 0.1])
    columns, errors = np.array([4, 5]), np.array([2.0, 1.0])
    nearer = bounded(moves, curvature, columns, errors)
    spread = np.sqrt((nearer**2).mean(0))
    assert np.isclose(spread[4], 2.0)
    np.testing.assert_array_equal(nearer[:, 5], moves[:, 5])
    # The others stand where the same pulls leave them beside lenses that went less far.
    rest = slice(0, 4)
    np.testing.assert_allclose(curvature[rest] @ nearer.T, curvature[rest] @ moves.T, atol=1e-9)


def test_lenses_within_their_priors_stay_as_drawn() -> None:
    moves = np.random.default_rng(0).normal(size=(100, 6))
    assert bounded(moves, np.eye(6), np.array([4, 5]), np.array([2.0, 3.0])) is moves


def test_terms_are_weak_unless_a_sure_gain_took_them() -> None:
    assert weak_terms([rung("lens_radial_1", 2.5), rung("lens_principal_point", 3.5)]) == {"k1"}
    assert weak_terms([rung("lens_radial_2", 2.5), rung("lens_radial_1", 3.5)]) == {"k2"}
    assert weak_terms([rung("lens_tangential", 1.5)]) == frozenset()
    assert weak_terms([Rung(name="lens_terms", taken=True, reason="a board gave the lenses")]) == frozenset()
