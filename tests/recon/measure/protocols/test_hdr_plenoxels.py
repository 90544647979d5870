"""HDR-Plenoxels' measure against closed forms."""

import numpy as np
import pytest

from recon.measure.protocols.hdr_plenoxels import score

LIGHT = np.random.default_rng(1).uniform(0.02, 0.9, (40, 60, 3))


def shown(stops: float) -> np.ndarray:
    return (LIGHT * 2.0**stops).clip(0, 1) ** (1 / 2.2)


def photograph(*stops: float) -> np.ndarray:
    return np.stack([shown(stop)[..., channel] for channel, stop in enumerate(stops)], axis=-1)


@pytest.mark.parametrize("stops", [(0.0, 0.0, 0.0), (0.3, -1.77, 2.4), (-5.1, -4.0, 1.0)])
def test_the_exposure_of_each_channel_is_found_on_the_left_half(stops):
    assert score(shown, photograph(*stops))["psnr"] > 45
    assert score(shown, photograph(*stops))["ssim"] > 0.99


def test_only_the_right_half_counts():
    taken = photograph(0.0, 0.0, 0.0)
    taken[:, 30:] += 0.1
    assert score(shown, taken)["psnr"] == pytest.approx(20.0, abs=0.01)
    wrong = taken.copy()
    wrong[:, :30] = 0.5 * taken[:, :30]  # the fit goes wrong with it
    assert score(shown, wrong)["psnr"] < 14
