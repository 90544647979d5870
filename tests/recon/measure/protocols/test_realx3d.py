"""RealX3D's measure against its definition, written out pixel by pixel."""

import math

import numpy as np
import pytest

from imaging.errors import InputError
from recon.measure.protocols.realx3d import common_exposure, depth_error, metres_of, score

rng = np.random.default_rng(7)
LIGHT = [rng.uniform(0.02, 0.4, (16, 20, 3)) for _ in range(2)]


def shown(light, stops=0.0):
    """Codes by the definition of IEC 61966-2-1."""
    linear = (light * 2.0**stops).clip(0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def written_out(a: np.ndarray, b: np.ndarray) -> float:
    """SSIM by the sums of Wang et al. 2004, window by window."""
    window = [[math.exp(-((i - 5) ** 2 + (j - 5) ** 2) / (2 * 1.5**2)) for j in range(11)] for i in range(11)]
    weights = np.array(window) / np.sum(window)
    values = []
    for c in range(3):
        for row in range(a.shape[0] - 10):
            for column in range(a.shape[1] - 10):
                x = a[row : row + 11, column : column + 11, c]
                y = b[row : row + 11, column : column + 11, c]
                mx, my = (weights * x).sum(), (weights * y).sum()
                vx, vy = (weights * (x - mx) ** 2).sum(), (weights * (y - my) ** 2).sum()
                both = (weights * (x - mx) * (y - my)).sum()
                values.append(
                    (2 * mx * my + 1e-4) * (2 * both + 9e-4) / ((mx**2 + my**2 + 1e-4) * (vx + vy + 9e-4))
                )
    return float(np.mean(values))


def test_psnr_and_ssim_are_the_means_over_views_of_eight_bit_pictures():
    photographs = [np.round(255 * shown(light, 0.3)) / 255 for light in LIGHT]
    figures = score([shown(light) for light in LIGHT], photographs)
    rendered = [np.round(255 * shown(light)) / 255 for light in LIGHT]
    errors = [np.mean((a - b) ** 2) for a, b in zip(rendered, photographs, strict=True)]
    assert figures["psnr"] == pytest.approx(np.mean([-10 * math.log10(error) for error in errors]), abs=1e-9)
    similar = [written_out(a, b) for a, b in zip(rendered, photographs, strict=True)]
    assert figures["ssim"] == pytest.approx(np.mean(similar), abs=1e-9)
    assert figures["psnr_exposed"] > figures["psnr"] + 10


@pytest.mark.parametrize("stops", [5.32, -1.2, 0.0])
def test_one_exposure_is_found_for_all_views(stops):
    dark = [light / 40 for light in LIGHT]
    rendered, photographs = ([shown(light, by) for light in dark] for by in (0.0, stops))
    assert common_exposure(rendered, photographs) == pytest.approx(stops, abs=0.02)


def test_one_exposure_serves_all_views_and_not_each():
    rendered = [shown(light / 8) for light in LIGHT]
    figures = score(rendered, [shown(LIGHT[0] / 8, 1.0), shown(LIGHT[1] / 8, 3.0)])
    assert figures["psnr_exposed"] < 25


def test_depth_is_compared_where_both_are_known():
    laser = np.kron(np.array([[3.0, 0.0], [2.0, 4.0]], np.float32), np.ones((4, 4), np.float32))
    depth = np.array([[3.5, 1.0], [np.inf, 4.1]], np.float32)
    assert depth_error(depth, laser) == pytest.approx((0.5 + 0.1) / 2, abs=1e-6)
    assert depth_error(depth, np.zeros((8, 8), np.float32)) is None


def test_metres_are_the_scale_of_the_similarity(tmp_path):
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    matrix = np.eye(4)
    matrix[:3, :3] = 0.532 * turn * np.linalg.det(turn)
    matrix[:3, 3] = 5, -2, 1
    np.save(tmp_path / "colmap2world.npy", matrix)
    assert metres_of(tmp_path / "colmap2world.npy") == pytest.approx(0.532, rel=1e-9)
    for bad in (np.zeros((4, 4)), np.eye(3)):
        np.save(tmp_path / "colmap2world.npy", bad)
        with pytest.raises(InputError, match="not a similarity"):
            metres_of(tmp_path / "colmap2world.npy")
    (tmp_path / "colmap2world.npy").write_bytes(b"")
    with pytest.raises(InputError, match="cannot be read"):
        metres_of(tmp_path / "colmap2world.npy")
