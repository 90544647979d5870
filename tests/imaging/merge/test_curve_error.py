"""The standard error of a response in the sigma of merged photographs: against light that is known."""

from dataclasses import replace

import numpy as np

from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.curve_error import with_curve_error
from imaging.merge.linear_frame import from_codes
from imaging.session.calibration import Response

CODES = np.arange(1, 256) / 255
TRUE = np.log(srgb_decode(CODES))
SCALES = (0.25, 0.5, 1.0, 2.0, 4.0)


def response(away: np.ndarray, sigma: np.ndarray) -> Response:
    return Response(
        kind="curve",
        codes=tuple(CODES),
        log_exposure=(tuple(TRUE + away),) * 3,
        sigma=(tuple(sigma),) * 3,
        evidence="made",
    )


def bracket(light: np.ndarray, curve: Response, seed: int) -> tuple[Merged, Merged]:
    """Merged without and with the error of the response: codes of one code of noise, not rounded."""
    rng = np.random.default_rng(seed)
    frames = []
    for k in SCALES:
        exposed = srgb_encode(np.clip(light * k, 0, 1)) + rng.standard_normal(light.shape) / 255
        frames.append(from_codes(np.where(light * k < 1, np.clip(exposed, 0, 1), 1.0), k, curve))
    merged = merge_bracket(frames)
    return merged, with_curve_error(merged, frames, curve)


def chi_square(merged: Merged, light: np.ndarray) -> float:
    assert merged.sigma is not None
    return float(np.mean(((merged.radiance - light) / merged.sigma)[merged.valid] ** 2))


def test_chi_square_against_the_truth_is_one_when_curves_err_as_they_say() -> None:
    """Over curves one standard error off: exponents that are wrong by 2 %, up or down."""
    across = TRUE - TRUE[127]
    before, after = [], []
    for seed in range(4):
        rng = np.random.default_rng((seed, 5))
        light = np.exp(rng.uniform(np.log(0.02), np.log(0.5), (20, 30, 3)))
        curve = response(0.02 * (-1) ** seed * across, 0.02 * np.abs(across))
        plain, full = bracket(light, curve, seed)
        before.append(chi_square(plain, light))
        after.append(chi_square(full, light))
    assert np.mean(before) > 2.5
    assert 0.9 < np.mean(after) < 1.25


def test_one_exposure_has_the_standard_error_of_its_code() -> None:
    codes = np.broadcast_to(np.linspace(20, 230, 64)[None, :, None] / 255, (2, 64, 3))
    curve = response(0 * TRUE, np.linspace(0.001, 0.05, 255))
    frame = from_codes(codes, 0.5, curve)
    merged = merge_bracket([frame])
    full = with_curve_error(merged, [frame], curve)
    assert merged.sigma is not None
    assert full.sigma is not None
    added = np.sqrt(full.sigma.astype(float) ** 2 - merged.sigma.astype(float) ** 2) / merged.radiance
    np.testing.assert_allclose(added, np.interp(codes, CODES, curve.sigma[0]), rtol=0.05)


def test_bounds_stay_bounds_and_what_has_no_standard_error_stays_as_it_is() -> None:
    codes = np.zeros((2, 3, 3))
    codes[1] = 1.0
    curve = response(0 * TRUE, np.full(255, 0.05))
    frames = [from_codes(codes, k, curve) for k in (0.5, 1.0)]
    merged = merge_bracket(frames)
    full = with_curve_error(merged, frames, curve)
    assert full.sigma is not None
    assert np.isinf(full.sigma).all()
    assert with_curve_error(merged, frames, curve.model_copy(update={"sigma": ()})) is merged
    blind = replace(merged, sigma=None)
    assert with_curve_error(blind, frames, curve) is blind
