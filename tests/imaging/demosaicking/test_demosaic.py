"""Demosaicing along edges: far better than bilinear on truth, honest about its error, without fringes."""

from unittest import mock

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, uniform_filter

from imaging.demosaicking.demosaic import demosaic
from imaging.metrics import hdr_psnr_mu
from imaging.sensor.cfa import BAYER, Cfa, bilinear, mosaic
from tests.foreign.scenes import spots

all_phases = pytest.mark.parametrize("cfa", BAYER)
TABLES = (Cfa.X_TRANS, Cfa.QUAD_BAYER, Cfa.KODAK_RGBW)
other_tables = pytest.mark.parametrize("cfa", TABLES)


def seen_by(cfa: Cfa, light: np.ndarray) -> np.ndarray:
    """Response of the channels of a table to light [H, W, 3]; W half of the sum."""
    return np.concatenate([light, light.sum(-1, keepdims=True) / 2], -1)[..., : len(cfa.letters)]


def scene(height: int = 90, width: int = 121) -> np.ndarray:
    """Light over 12 stops [H, W, 3]: soft shading, coloured patches with slanted edges, stripes, a lamp."""
    rows, columns = np.mgrid[:height, :width].astype(float)
    shade = np.exp2(-5 + 3 * np.sin(columns / 37) + 2 * np.cos(rows / 29))
    patch = (np.floor((columns + 0.3 * rows) / 17) + 2 * np.floor((rows - 0.2 * columns) / 13)).astype(
        int
    ) % 5
    albedo = np.array(
        [[0.8, 0.8, 0.8], [0.7, 0.2, 0.1], [0.1, 0.4, 0.2], [0.1, 0.2, 0.6], [0.05, 0.05, 0.05]]
    )
    stripes = 1 + 0.4 * np.sin((columns + 2 * rows) / 2.2)
    light = (shade * np.where(patch == 0, stripes, 1))[..., None] * albedo[patch]
    light[np.hypot(rows - 30, columns - 60) < 6] = (60.0, 50.0, 30.0)
    # A lens blurs by some half of a pixel.
    weights = np.exp(-(np.arange(-2, 3) ** 2) / (2 * 0.5**2))
    weights /= weights.sum()
    for axis in (0, 1):
        light = np.apply_along_axis(
            lambda line: np.convolve(np.pad(line, 2, "edge"), weights, "valid"), axis, light
        )
    return light


@all_phases
def test_it_beats_bilinear_by_far_on_truth(cfa: Cfa) -> None:
    truth = scene()
    sites = mosaic(truth, cfa)
    ours, plain = (
        hdr_psnr_mu(rgb, truth, truth.max()) for rgb in (demosaic(sites, cfa).rgb, bilinear(sites, cfa)[0])
    )
    assert ours > plain + 4


@all_phases
def test_nothing_is_brighter_than_what_was_recorded(cfa: Cfa) -> None:
    sites = mosaic(scene(), cfa)
    result = demosaic(sites, cfa).rgb
    for channel in range(3):
        recorded = sites[cfa.channels(*sites.shape) == channel]
        assert result[..., channel].max() <= np.float32(recorded.max())
        assert result[..., channel].min() >= np.float32(recorded.min())


@all_phases
def test_a_lamp_has_no_fringe_of_another_colour(cfa: Cfa) -> None:
    """Grey stays grey at an edge of ten stops, within what bilinear interpolation makes of it."""
    truth = scene().mean(-1, keepdims=True).repeat(3, -1)
    sites = mosaic(truth, cfa)

    def tint(rgb: np.ndarray) -> float:
        return float(
            np.mean(np.abs(np.log2(np.maximum(rgb[..., ::2], 1e-6) / np.maximum(rgb[..., 1:2], 1e-6))))
        )

    assert tint(demosaic(sites, cfa).rgb) < 0.25 * tint(bilinear(sites, cfa)[0])


@all_phases
@pytest.mark.parametrize(("height", "width"), [(2, 2), (3, 3), (8, 9), (11, 6)])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_one_colour_stays_that_colour(cfa: Cfa, height: int, width: int, unit: float) -> None:
    rgb = unit * np.broadcast_to(np.array([0.25, 0.5, 3.0]), (height, width, 3))
    result = demosaic(mosaic(rgb, cfa), cfa)
    assert result.rgb.dtype == np.float32
    assert result.known.all()
    np.testing.assert_allclose(result.rgb, rgb, rtol=1e-5)


@all_phases
def test_recorded_values_are_kept(cfa: Cfa) -> None:
    rgb = np.random.default_rng(2).normal(0.1, 1, (9, 10, 3)).astype(np.float32)
    sites = mosaic(rgb, cfa)
    assert np.array_equal(mosaic(demosaic(sites, cfa).rgb, cfa), sites)


@all_phases
@pytest.mark.parametrize("bad", [(4, 5), (5, 4), (4, 4), (5, 5)])
@pytest.mark.parametrize("value", [1e6, np.nan, np.inf])
def test_a_photosite_without_a_value_does_not_spread(cfa: Cfa, bad: tuple[int, int], value: float) -> None:
    rgb = np.broadcast_to(np.array([0.25, 0.5, 3.0]), (10, 11, 3))
    sites = mosaic(rgb, cfa).copy()
    valid = np.ones(sites.shape, bool)
    sites[bad], valid[bad] = value, False
    result = demosaic(sites, cfa, valid)
    expected, filled = rgb.copy(), np.ones(rgb.shape, bool)
    channel = cfa.channels(10, 11)[bad]
    if channel != 1:  # red and blue have no second photosite within reach, green has four
        expected[(*bad, channel)], filled[(*bad, channel)] = 0.0, False
    assert np.array_equal(result.known, filled)
    np.testing.assert_allclose(result.rgb, expected, rtol=1e-5)


def test_a_dead_photosite_costs_its_neighbours_no_more_than_bilinear() -> None:
    truth, cfa = scene(), Cfa.RGGB
    sites = mosaic(truth, cfa)
    valid = np.random.default_rng(3).random(sites.shape) > 0.01
    result, plain = demosaic(np.where(valid, sites, 1e3), cfa, valid), bilinear(sites, cfa, valid)
    assert np.array_equal(result.known, plain[1])
    ours, theirs = (
        hdr_psnr_mu(np.where(result.known, rgb, truth), truth, truth.max()) for rgb in (result.rgb, plain[0])
    )
    assert ours > theirs + 3


@pytest.mark.parametrize("image", [np.zeros((6, 8)), np.full((6, 8), -1.0), np.full((6, 8), np.nan)])
def test_pictures_of_nothing(image: np.ndarray) -> None:
    result = demosaic(image, Cfa.RGGB, sigma=np.full(image.shape, np.inf))
    assert np.isfinite(result.rgb).all()
    assert result.known.all() == np.isfinite(image).all()


@pytest.mark.parametrize(
    ("cfa", "close", "close_sigma"),
    [(Cfa.GBRG, {"rtol": 1e-5}, 1e-4), (Cfa.X_TRANS, {"rtol": 1e-4, "atol": 1e-6}, 1e-2)],
)
def test_strips_are_seamless(cfa: Cfa, close: dict[str, float], close_sigma: float) -> None:
    light, sigma = mosaic(scene(), cfa), np.full((90, 121), 1e-3)
    whole = demosaic(light, cfa, sigma=sigma)
    with mock.patch("imaging.demosaicking.demosaic.ROWS", 32):
        parts = demosaic(light, cfa, sigma=sigma)
    assert whole.sigma is not None
    assert parts.sigma is not None
    np.testing.assert_allclose(parts.rgb, whole.rgb, **close)
    np.testing.assert_allclose(parts.sigma, whole.sigma, rtol=close_sigma)


@pytest.mark.parametrize("cfa", [Cfa.GBRG, Cfa.X_TRANS])
def test_without_its_spread_it_is_the_same_picture(cfa: Cfa) -> None:
    light, sigma = mosaic(scene(), cfa), np.full((90, 121), 1e-2)
    valid = np.random.default_rng(3).random(light.shape) > 0.01
    whole, plain = (demosaic(light, cfa, valid, sigma, spread=spread) for spread in (True, False))
    assert plain.sigma is None
    np.testing.assert_array_equal(plain.rgb, whole.rgb)
    np.testing.assert_array_equal(plain.known, whole.known)


@pytest.mark.parametrize("noise", [0.002, 0.02], ids=["little noise", "much noise"])
def test_sigma_is_the_error_in_smooth_and_in_textured_places(noise: float) -> None:
    """Some 95 of 100 errors lie within two sigma; 90 do at hard edges, of which no local sign tells all."""
    truth, cfa = scene(240, 320), Cfa.RGGB
    sigma = noise * np.sqrt(mosaic(truth, cfa) + 0.01)
    sites = mosaic(truth, cfa) + sigma * np.random.default_rng(4).standard_normal(sigma.shape)
    result = demosaic(sites, cfa, sigma=sigma)
    assert result.sigma is not None
    assert np.array_equal(mosaic(result.sigma, cfa), sigma.astype(np.float32))
    interpolated = np.arange(3) != cfa.channels(*sigma.shape)[..., None]
    share = (result.rgb - truth) / result.sigma
    log = np.log(truth + 0.01)
    texture = np.abs(np.stack(np.gradient(log, axis=(0, 1)))).max((0, 3))
    for place in (texture < np.percentile(texture, 50), texture > np.percentile(texture, 80)):
        errors = share[place[..., None] & interpolated]
        assert 0.87 < np.mean(np.abs(errors) < 2) < 0.98
        assert 0.6 < np.mean(np.minimum(np.abs(errors), 5) ** 2) < 2.0


@pytest.mark.parametrize("seed", [1, 2])
def test_sigma_is_the_error_however_much_colour_changes(seed: int) -> None:
    """Blots of all sizes and colours, as foliage has them: no edge along which colour stays the same."""
    cfa, rng = Cfa.RGGB, np.random.default_rng(seed)
    rows, columns = np.mgrid[:256, :256]
    fade = np.exp2(-6 * columns / 256)[..., None]  # of the blots: from all of their contrast to hardly any
    blots = gaussian_filter(spots(seed, 256).astype(float), (0.6, 0.6, 0))
    truth = 0.4 * np.exp(fade * np.log(blots / 0.4)) * np.exp2(2 * np.sin(rows / 40))[..., None]
    sigma = 0.01 * np.sqrt(mosaic(truth, cfa))
    result = demosaic(mosaic(truth, cfa) + sigma * rng.standard_normal(sigma.shape), cfa, sigma=sigma)
    assert result.sigma is not None
    share = np.minimum(np.abs(result.rgb - truth) / result.sigma, 10) ** 2
    interpolated = np.arange(3) != cfa.channels(*sigma.shape)[..., None]
    log = np.log(truth)
    colour = np.sqrt(
        sum(uniform_filter(one**2, 3) - uniform_filter(one, 3) ** 2 for one in (log - log[..., 1:2]).T)
    ).T
    for place in np.array_split(np.argsort(colour, axis=None), 6):
        chosen = np.zeros(colour.size, bool)
        chosen[place] = True
        assert 0.5 < np.mean(share[chosen.reshape(colour.shape)[..., None] & interpolated]) < 2.1


def test_a_bound_makes_what_hangs_on_it_one() -> None:
    sigma = np.full((12, 12), 0.01)
    sigma[6, 6] = np.inf
    result = demosaic(np.ones((12, 12)), Cfa.RGGB, sigma=sigma)
    assert result.sigma is not None
    assert np.isinf(result.sigma[6, 7, 0])
    assert np.isfinite(result.sigma[9:, :]).all()


@other_tables
@pytest.mark.parametrize("shift", [(0, 0), (1, 2)])
def test_other_tables_beat_bilinear_on_truth(cfa: Cfa, shift: tuple[int, int]) -> None:
    cfa = cfa.cropped(*shift)
    truth = seen_by(cfa, scene())
    sites = mosaic(truth, cfa)
    result, plain = demosaic(sites, cfa), bilinear(sites, cfa)[0]
    ours, theirs = (hdr_psnr_mu(light, truth, truth.max()) for light in (result.rgb, plain))
    assert ours > theirs + 3
    assert np.array_equal(mosaic(result.rgb, cfa), sites.astype(np.float32))
    for channel in range(len(cfa.letters)):
        recorded = sites[cfa.channels(*sites.shape) == channel]
        assert np.float32(recorded.min()) <= result.rgb[..., channel].min()
        assert result.rgb[..., channel].max() <= np.float32(recorded.max())


@other_tables
def test_sigma_of_other_tables_is_the_error(cfa: Cfa) -> None:
    truth = seen_by(cfa, scene(150, 200))
    sigma = 0.01 * np.sqrt(mosaic(truth, cfa) + 0.01)
    sites = mosaic(truth, cfa) + sigma * np.random.default_rng(4).standard_normal(sigma.shape)
    result = demosaic(sites, cfa, sigma=sigma)
    assert result.sigma is not None
    assert np.array_equal(mosaic(result.sigma, cfa), sigma.astype(np.float32))
    share = (result.rgb - truth) / result.sigma
    for channel in range(len(cfa.letters)):
        errors = share[..., channel][cfa.channels(*sigma.shape) != channel]
        assert 0.85 < np.mean(np.abs(errors) < 2) < 0.99
        assert 0.5 < np.median(errors**2) / 0.455 < 1.5


@other_tables
def test_what_has_no_value_spreads_into_no_other_table(cfa: Cfa) -> None:
    truth = seen_by(cfa, scene())
    sites = mosaic(truth, cfa)
    valid = np.random.default_rng(3).random(sites.shape) > 0.01
    result, plain = demosaic(np.where(valid, sites, 1e3), cfa, valid), bilinear(sites, cfa, valid)
    assert np.array_equal(result.known, plain[1])
    ours, theirs = (
        hdr_psnr_mu(np.where(result.known, light, truth), truth, truth.max())
        for light in (result.rgb, plain[0])
    )
    assert ours > theirs + 2


def test_mono_is_its_own_picture() -> None:
    light, sigma = scene()[..., 1], np.full((90, 121), 0.1)
    result = demosaic(light, Cfa.MONO, sigma=sigma)
    assert np.array_equal(result.rgb[..., 0], light.astype(np.float32))
    assert result.sigma is not None
    assert np.array_equal(result.sigma[..., 0], sigma.astype(np.float32))
