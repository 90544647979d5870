"""RawNeRF's measure against closed forms."""

import numpy as np
import pytest

from imaging.errors import InputError
from imaging.files.tiff.dng import write_dng
from imaging.metrics import PSNR_CAP
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import RawMosaic
from recon.measure.protocols.rawnerf import (
    Reference,
    affine_aligned,
    developed,
    read_reference,
    rec709_from_camera,
    score,
)

RNG = np.random.default_rng(7)
PICTURE = RNG.uniform(0.01, 0.2, (64, 80, 3)).repeat(2, axis=0).repeat(2, axis=1)
"""In blocks of a tile, so that a mosaic of it has each colour of each block."""
COLOUR = ((0.83, -0.27, -0.1), (-0.45, 1.3, 0.17), (-0.07, 0.2, 0.54))


def reference(picture=PICTURE, matrix=None) -> Reference:
    signal = mosaic(picture, Cfa.GRBG).astype(np.float32)
    return Reference(signal, Cfa.GRBG, np.eye(3) if matrix is None else matrix)


def test_the_line_of_each_channel_is_found_and_undone():
    slope, shift = np.array([2.0, 0.5, -3.0]), np.array([0.1, -0.2, 0.0])
    np.testing.assert_allclose(affine_aligned(PICTURE * slope + shift, PICTURE), PICTURE, atol=1e-12)


def test_noise_of_the_estimate_does_not_flatten_the_fitted_line():
    """Fitted from the truth: with E[noise] = 0 the slope is that of the signal, whatever its noise."""
    truth = RNG.uniform(0, 1, (200, 200, 3))
    noise = RNG.normal(0, 1.0, truth.shape)
    aligned = affine_aligned(3 * truth + 1 + 3 * noise, truth)
    assert np.var(aligned - truth) == pytest.approx(1.0, rel=0.03)


def test_channels_with_nothing_in_common_are_only_moved():
    flat = np.ones_like(PICTURE)
    np.testing.assert_allclose(affine_aligned(5 * flat, flat), flat)
    aligned = affine_aligned(flat * 5, PICTURE)
    np.testing.assert_allclose(aligned, np.broadcast_to(PICTURE.mean(axis=(0, 1)), PICTURE.shape))


def test_raw_psnr_is_of_the_mosaic_over_white_without_the_border():
    off = PICTURE.copy()
    off[16:-16, 16:-16, 1] += 0.01  # half of all photosites are green
    off[:16] = 100.0
    assert score(off, reference())["raw_psnr"] == pytest.approx(40 + 10 * np.log10(2), abs=1e-4)
    assert score(PICTURE, reference())["raw_psnr"] == pytest.approx(PSNR_CAP, abs=20)
    lamp = PICTURE.copy()
    lamp[40:44, 40:44] = 1.0
    glaring = np.where(lamp == 1.0, 1e4, lamp)
    assert score(glaring, reference(lamp)) == score(lamp, reference(lamp))
    bright = PICTURE + 2.0
    assert score(bright * 3, reference(bright))["raw_psnr"] == PSNR_CAP  # white is white


def test_an_affine_change_of_the_signal_costs_no_rgb():
    """But for what interpolation makes at the borders of blocks, which both have."""
    smooth = np.broadcast_to(
        0.05 + 0.1 * np.linspace(0, 1, 160)[None, :, None] * np.array([1.0, 0.7, 0.4]), (128, 160, 3)
    )
    same, changed = score(smooth, reference(smooth)), score(smooth * 1.7 - 0.01, reference(smooth))
    assert changed["rgb_psnr"] == pytest.approx(same["rgb_psnr"], abs=0.01)
    assert same["rgb_psnr"] > 60
    assert same["rgb_ssim"] == pytest.approx(1.0, abs=1e-4)
    assert changed["raw_psnr"] < 30


def test_the_picture_is_that_of_the_white_percentile_and_srgb():
    light = np.array([[[0.5, 0.25, 2.0]]])
    codes = developed(light, np.eye(3), 0.5)
    np.testing.assert_allclose(codes, [[[1.0, 0.7353569830524495, 1.0]]], atol=1e-12)
    np.testing.assert_allclose(developed(light, np.diag([1.0, 2.0, 0.25]), 0.5), 1.0)


def test_neutral_becomes_white_and_the_matrix_is_that_of_the_camera():
    neutral = np.array([0.8357477784, 1.0, 0.3002712429])
    matrix = rec709_from_camera(neutral, COLOUR)
    np.testing.assert_allclose(matrix @ neutral, 1.0)
    # the scale of a ColorMatrix says nothing
    np.testing.assert_allclose(rec709_from_camera(neutral, 3 * np.array(COLOUR)), matrix)


def test_a_merged_mosaic_is_read_by_the_levels_and_the_exposure_of_the_shot(tmp_path):
    codes = RNG.integers(600, 4000, (24, 30), dtype=np.uint16)
    black, neutral = ((528.0, 529.0), (527.0, 528.0)), (0.5, 1.0, 0.4)
    shot = RawMosaic(codes, Cfa.RGGB, black, 4095, neutral=neutral, camera_from_xyz=COLOUR)
    write_dng(tmp_path / "shot.dng", shot)
    # whatever the merged file says of its own levels
    write_dng(tmp_path / "merged.dng", RawMosaic(4 * codes + 2, Cfa.RGGB, ((0.0,),), 65535))
    reference_mosaic = read_reference(tmp_path / "merged.dng", tmp_path / "shot.dng", 0.25)
    tile = np.tile(black, (12, 15))
    np.testing.assert_allclose(
        reference_mosaic.signal, 0.25 * (codes + 0.5 - tile) / (4095 - tile), rtol=1e-5
    )
    assert reference_mosaic.cfa == Cfa.RGGB
    np.testing.assert_allclose(reference_mosaic.rec709_from_camera @ neutral, 1.0, rtol=1e-4)
    write_dng(tmp_path / "small.dng", RawMosaic(codes[:, :24], Cfa.RGGB, black, 4095))
    with pytest.raises(InputError, match=r"merged\.dng and .*small\.dng differ in size"):
        read_reference(tmp_path / "merged.dng", tmp_path / "small.dng", 1.0)
    write_dng(tmp_path / "grey.dng", RawMosaic(codes, Cfa.RGGB, black, 4095))
    with pytest.raises(InputError, match=r"grey\.dng has no white balance"):
        read_reference(tmp_path / "merged.dng", tmp_path / "grey.dng", 1.0)
