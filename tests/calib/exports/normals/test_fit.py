"""Photometric stereo against closed forms: shadows, highlights, noise, errors, and lamps that are near."""

from pathlib import Path

import numpy as np
import pytest

from calib.exports.normals.fit import fit
from calib.exports.normals.lamps import check_lamps, differences, incoming, on_plane
from imaging.errors import InputError
from imaging.optics.lens import Lens, project
from imaging.session.lamps import LampsRecord

RING = [(np.cos(turn), np.sin(turn), 0.9) for turn in np.arange(12) * np.pi / 6] + [
    (0.1, 0.2, 1.0),
    (0, 0, 1),
]


def record(places, **values) -> LampsRecord:
    return LampsRecord(reason="a test", places=dict(enumerate(places)), **{"spread": 0.001, **values})


def surfaces(pixels: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Normals up to 60 degrees from the camera's axis [P, 3], and albedo in three channels [P, 3]."""
    noise = np.random.default_rng(seed)
    tilt, turn = np.radians(noise.uniform(0, 60, pixels)), noise.uniform(0, 2 * np.pi, pixels)
    normals = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], -1)
    return normals, noise.uniform(0.1, 0.9, (pixels, 3))


def degrees(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.degrees(2 * np.arcsin(np.linalg.norm(one - other, axis=-1) / 2))


def light_of(lamps: np.ndarray, normals: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    return np.maximum(np.einsum("lpi,pi->lp", lamps, normals), 0.0)[..., None] * albedo


def test_stated_errors_are_those_of_noise() -> None:
    normals, albedo = surfaces(1500, 1)
    lamps = np.array(incoming(record(RING), range(14), None, 1500))
    light, noise = light_of(lamps, normals, albedo), np.random.default_rng(2)
    sigma = 0.002 + 0.02 * np.sqrt(light)
    result = fit(light + sigma * noise.standard_normal(light.shape), sigma, lamps, 0.001)
    assert result.known.all()
    off = np.radians(degrees(result.normal, normals)) / result.error
    # Both errors across the normal together; a shadow's edge or its lamps make some too large.
    assert np.mean(off**2) == pytest.approx(1.0, abs=0.2)
    z = (result.albedo - albedo) / result.albedo_error
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.15)


def test_shadows_highlights_and_what_is_saturated_are_left_out() -> None:
    normals, albedo = surfaces(1000, 3)
    lamps = np.array(incoming(record(RING), range(14), None, 1000))
    light, noise = light_of(lamps, normals, albedo[:, :1]), np.random.default_rng(4)
    light[noise.random(light.shape) < 0.15] = 0.0  # cast shadows
    light[noise.random(light.shape) < 0.1] *= 5.0  # highlights
    sigma = np.full(light.shape, 1e-4)
    sigma[noise.random(light.shape) < 0.1] = np.inf
    light[np.isinf(sigma)] *= 0.3  # bounds
    result = fit(light, sigma, lamps, 0.001)
    assert (degrees(result.normal, normals) < 0.5)[result.known].mean() > 0.97
    assert result.known.mean() > 0.97
    for first in range(0, 1000, 100):  # whatever was in memory, and in the pixels before
        part = np.s_[:, first : first + 100]
        again = fit(light[part], sigma[part], lamps[part], 0.001)
        assert (again.normal == result.normal[first : first + 100]).all()


def test_fewer_than_three_lamps_make_a_pixel_unknown() -> None:
    normals, albedo = surfaces(50, 5)
    lamps = np.array(incoming(record(RING), range(14), None, 50))
    light, sigma = light_of(lamps, normals, albedo), np.full((14, 50, 3), 1e-3)
    sigma[2:, :10] = np.inf
    light[:, 10:20] = 0.0
    light[5:, 20:30] = np.nan
    sigma[:2, 30:40] = 0.0
    result = fit(light, sigma, lamps, 0.001)
    assert not result.known[:20].any()
    assert not result.normal[:20].any()
    assert not result.albedo[:20].any()
    assert np.isinf(result.albedo_error[:20]).all()
    assert result.known[30:].all()


def test_near_lamps_light_each_place_from_its_own_side() -> None:
    """A point lamp over a plane: the light is cos / d^2, by the pixel's place through the lens."""
    lens = Lens(
        model="OPENCV", width=40, height=30, fx=40, fy=40, cx=20.5, cy=14.8, k1=-0.1, k2=0.0, p1=0.0, p2=0.0
    )
    depth, lamp = 0.5, np.array([0.3, 0.2, 0.7])
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.15, 0.15, 9))
    pixels = project(lens, np.stack([x, -y, np.full_like(x, depth)], -1))
    ends = np.array([[0.0, 15.0], [40.0, 15.0], [20.0, 15.0]])
    where = record([lamp], brightness={0: 1.5})
    # The plane's places of the ends of the middle row, by fine search through the lens.
    search = np.linspace(-0.4, 0.4, 200_001)
    row = project(lens, np.stack([search, np.zeros_like(search), np.full_like(search, depth)], -1))[:, 0]
    left, right, middle = (float(np.interp(end, row, search)) for end in ends[:, 0])
    record_across = where.model_copy(update={"across": right - left})
    flat = on_plane(record_across, lens, 40, 30)
    assert flat is not None
    columns, rows = np.round(pixels[..., 0] - 0.5).astype(int), np.round(pixels[..., 1] - 0.5).astype(int)
    inside = (columns >= 0) & (columns < 40) & (rows >= 0) & (rows < 30)
    near = flat[rows[inside], columns[inside]]
    assert np.abs(near[:, 0] - (x[inside] - middle)).max() < 0.6 * depth / 40 / 0.9
    assert np.abs(near[:, 1] - y[inside]).max() < 0.7 * depth / 40 / 0.9
    light = incoming(record_across, [0], near, len(near))[0]
    towards = lamp - near
    distance = np.linalg.norm(towards, axis=-1, keepdims=True)
    assert light == pytest.approx(1.5 * (lamp @ lamp) * towards / distance**3)


@pytest.mark.parametrize(
    ("places", "frames", "cause"),
    [
        (RING[:2], [0, 1], "has 2 lamps of frames that have been shot"),
        ([*RING[:2], None], [0, 1, 2], "has 2 lamps of frames that have been shot"),
        (RING, [0, 1, 13, 14, 20], "states no lamp for frame 14, 20"),
        ([(1.0, 0.0, 1.0), (0.0, 0.0, 1.0), (-1.0, 0.01, 1.0), (2.0, 0.0, 0.5)], range(4), "one plane"),
    ],
)
def test_lamps_that_determine_no_normal_are_refused(places, frames, cause: str) -> None:
    with pytest.raises(InputError, match=cause):
        check_lamps(record(places), list(frames), Path("S/lamps.json"))
    check_lamps(record(RING), range(14), Path("S/lamps.json"))


def test_a_lamp_that_differs_is_named_and_other_lamps_altogether_are_refused() -> None:
    ratios = np.random.default_rng(6).normal(1.0, 0.02, (14, 500))
    assert differences(ratios, 0.97, record(RING), range(14), Path("lamps.json"))[1] == ()
    ratios[3] *= 0.6
    misfit, (warning,) = differences(ratios, 0.97, record(RING), range(14), Path("lamps.json"))
    assert misfit < 0.03
    assert "The lamp of frame 3 has 40 % less light" in warning
    with pytest.raises(InputError, match="check the order"):
        differences(ratios, 0.5, record(RING), range(14), Path("lamps.json"))
