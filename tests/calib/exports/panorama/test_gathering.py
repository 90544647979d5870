"""Views gathered on a map, against light in closed form: right light, right error, and what is not shown."""

import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest

from calib.exports.panorama.gathering import Gathering, Map, SeenView, sampling
from calib.exports.panorama.layout import directions, solid_angles
from calib.exports.panorama.seams import seams
from calib.exports.panorama.sun import RECOVERED, clipped_regions, share_unseen, with_sun
from imaging.errors import InputError
from imaging.merge.picture import CLIPPED, DARK, HIDDEN, NOTHING, Picture
from imaging.optics.lens import Lens, rays
from imaging.session.view_id import ViewId

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
LENS = Lens(model="OPENCV_FISHEYE", width=160, height=160, fx=60, fy=60, cx=80, cy=80, k1=0.02)
TURNS = [cv2.Rodrigues(np.array([0.0, np.pi / 2 * step, 0.0]))[0] for step in range(4)]
TURNS += [cv2.Rodrigues(np.array([sign * np.pi / 2, 0.0, 0.0]))[0] for sign in (-1, 1)]
TURNS = [np.diag([-1.0, -1.0, 1.0]) @ turn for turn in TURNS]  # x of a camera is right, of the map left
ROWS = 90


def light_of(ahead: np.ndarray) -> np.ndarray:
    """Light from directions [..., 3], smooth, of three colours."""
    x, y, z = np.moveaxis(ahead, -1, 0)
    return np.stack([3 + x, 2 + 0.5 * y * z, 4 + z * x], axis=-1)


def picture_of(turn: np.ndarray, sigma: float | None = 0.02, seed: int = 0) -> Picture:
    y, x = np.mgrid[:160, :160] + 0.5
    light = light_of(rays(LENS, np.stack([x, y], axis=-1)) @ turn)
    light = light + np.random.default_rng(seed).normal(0, sigma or 0, light.shape)
    each = None if sigma is None else np.full(light.shape, sigma, np.float32)
    return Picture(light.astype(np.float32), each, np.zeros((160, 160), np.intp), True)


def gathered(pictures: list[Picture], turns: list[np.ndarray]) -> Gathering:
    gathering = Gathering(ROWS)
    for picture, turn in zip(pictures, turns, strict=True):
        gathering.add(SeenView(picture, LENS, turn), 2, noise=picture.sigma is not None)
    return gathering


def test_directions_are_those_of_openexr() -> None:
    every = directions(ROWS, 0, ROWS)
    np.testing.assert_allclose(every[0, 0, 1], 1, atol=1e-3)  # the uppermost row looks up
    np.testing.assert_allclose(every[ROWS // 2, ROWS], (0, 0, 1), atol=0.02)  # the middle looks along z
    np.testing.assert_allclose(every[ROWS // 2, ROWS // 2], (1, 0, 0), atol=0.02)  # left of it is x
    assert 2 * ROWS * solid_angles(ROWS).sum() == pytest.approx(4 * np.pi)


def test_the_map_has_the_light_of_all_sides_and_says_how_sure_it_is() -> None:
    result = gathered([picture_of(turn, seed=seed) for seed, turn in enumerate(TURNS)], TURNS).result()
    assert (result.mask == 0).all()
    error = result.light - light_of(directions(ROWS, 0, ROWS))
    assert np.abs(error).max() < 0.1
    assert abs(error.mean()) < 2e-4
    assert result.sigma is not None
    # Averages over pixels are surer than one pixel, and no surer than all that were looked at.
    z = error / result.sigma
    assert 0.3 < z.std() < 1.0


def test_surer_views_count_by_the_inverse_of_their_variance() -> None:
    dark, bright = picture_of(TURNS[0], None), picture_of(TURNS[0], None)
    pictures = [
        Picture(dark.light, np.full_like(dark.light, 0.1), dark.mask, True),
        Picture(1.1 * bright.light, np.full_like(dark.light, 0.2), dark.mask, True),
    ]
    result = gathered(pictures, [TURNS[0]] * 2).result()
    shown = result.mask == 0
    ratio = (result.light / light_of(directions(ROWS, 0, ROWS)))[shown]
    np.testing.assert_allclose(ratio, (100 * 1.0 + 25 * 1.1) / 125, rtol=4e-3)
    np.testing.assert_allclose(result.sigma[shown], (1 / 0.1**2 + 1 / 0.2**2) ** -0.5, rtol=1e-3)
    assert (result.mask[~shown] == NOTHING).all()
    assert 0.2 < shown.mean() < 0.6


def test_bounds_count_only_where_nothing_was_measured() -> None:
    clipped = picture_of(TURNS[0])
    clipped.mask[70:90, 70:90] = CLIPPED
    clipped.light[70:90, 70:90] = 1.0
    alone = gathered([clipped], [TURNS[0]]).result()
    inside = alone.mask == CLIPPED
    assert inside.any()
    assert np.median(alone.light[inside]) == pytest.approx(1.0)
    assert alone.sigma is not None
    assert np.isinf(alone.sigma[inside]).all()
    both = gathered([clipped, picture_of(TURNS[0], seed=3)], [TURNS[0]] * 2).result()
    assert (both.mask[inside] == 0).all()
    assert np.abs(both.light - light_of(directions(ROWS, 0, ROWS)))[inside].max() < 0.1
    black = Picture(clipped.light, clipped.sigma, np.full_like(clipped.mask, DARK), True)
    assert set(np.unique(gathered([black], [TURNS[0]]).result().mask)) == {DARK, NOTHING}
    hidden = Picture(clipped.light, clipped.sigma, np.full_like(clipped.mask, HIDDEN), True)
    assert (gathered([hidden], [TURNS[0]]).result().mask == NOTHING).all()


def test_photographs_without_a_known_noise_are_averaged() -> None:
    result = gathered([picture_of(turn, None) for turn in TURNS], TURNS).result()
    assert result.sigma is None
    np.testing.assert_allclose(result.light, light_of(directions(ROWS, 0, ROWS)), atol=5e-3)


@pytest.mark.parametrize("blind", [0, 1])
def test_a_view_without_a_known_noise_counts_as_the_others_do(blind: int) -> None:
    sure = [picture_of(TURNS[0]), picture_of(TURNS[1])]
    sure[1].light[:] *= np.float32(1.1)
    mixed = [replace(one, sigma=None) if index == blind else one for index, one in enumerate(sure)]
    result = gathered(mixed, TURNS[:2]).result()
    assert result.sigma is None
    np.testing.assert_allclose(result.light, gathered(sure, TURNS[:2]).result().light, rtol=1e-5)


def test_a_row_of_many_columns_is_looked_up_in_parts() -> None:
    rows, samples = 1200, 16  # 38400 columns, more than OpenCV draws at once
    strip = SeenView(picture_of(TURNS[0], None), LENS, TURNS[0]).look(rows, 600, 601, samples)
    assert strip is not None
    shown = np.isfinite(strip.light).all(axis=-1)
    assert 0.2 < shown.mean() < 0.6
    np.testing.assert_allclose(strip.light[shown], light_of(directions(rows, 600, 601))[shown], atol=5e-3)


@pytest.mark.parametrize("rows", [12, 32])
@pytest.mark.parametrize("offset", [(0, 0), (4, 3), (11, -7)], ids=str)
def test_a_small_lamp_has_its_energy_on_a_coarse_map(rows: int, offset: tuple[int, int]) -> None:
    height, width, focal = 400, 600, 480.0
    lens = Lens(model="PINHOLE", width=width, height=height, fx=focal, fy=focal, cx=width / 2, cy=height / 2)
    light = np.full((height, width, 3), 1e-6, np.float32)
    x, y = 300 + offset[0], 200 + offset[1]
    light[y : y + 4, x : x + 4] = 1e6
    raised = cv2.Rodrigues(np.array([0.9, 0.0, 0.0]))[0]  # where texels are narrower at their upper end
    view = Picture(light, np.ones_like(light), np.zeros((height, width), np.intp), True)
    gathering = Gathering(rows)
    samples, shrunk = sampling(lens, rows)
    gathering.add(SeenView(view, lens, TURNS[0] @ raised, shrunk), samples, noise=True)
    energy = float((gathering.result().light[..., 1] * solid_angles(rows)).sum())
    assert energy == pytest.approx(1e6 * 16 / focal**2, rel=0.1)


@pytest.mark.parametrize(("fx", "fy", "column"), [(92, 92, 298), (92, 92, 303), (120, 240, 270)], ids=str)
@pytest.mark.parametrize("rows", [64, 250])
def test_a_small_lamp_has_its_energy_off_the_axis(fx: float, fy: float, column: int, rows: int) -> None:
    height, width = 180, 320
    lens = Lens(model="PINHOLE", width=width, height=height, fx=fx, fy=fy, cx=width / 2, cy=height / 2)
    light = np.full((height, width, 3), 1e-6, np.float32)
    light[height // 2 + 3, column] = 1e6
    tangents = np.array([(column + 0.5 - width / 2) / fx, 3.5 / fy])
    view = Picture(light, np.ones_like(light), np.zeros((height, width), np.intp), True)
    gathering = Gathering(rows)
    samples, shrunk = sampling(lens, rows)
    gathering.add(SeenView(view, lens, TURNS[0], shrunk), samples, noise=True)
    energy = float((gathering.result().light[..., 1] * solid_angles(rows)).sum())
    assert energy == pytest.approx(1e6 / (fx * fy) * (1 + tangents @ tangents) ** -1.5, rel=0.15)


def test_what_is_averaged_first_stays_saturated_and_shows_the_same() -> None:
    clipped = picture_of(TURNS[0])
    clipped.mask[79, 79], clipped.light[79, 79] = CLIPPED, 900.0
    maps = []
    for shrunk in (1, 3):
        gathering = Gathering(20)
        gathering.add(SeenView(clipped, LENS, TURNS[0], shrunk), 12, noise=True)
        maps.append(gathering.result())
    assert [(one.mask == CLIPPED).sum() > 0 for one in maps] == [True, True]
    both = (maps[0].mask == 0) & (maps[1].mask == 0)
    assert both.mean() > 0.2
    np.testing.assert_allclose(maps[1].light[both], maps[0].light[both], atol=0.02)


def test_seams_are_differences_in_stops() -> None:
    brighter = picture_of(TURNS[1])
    brighter.light[:] *= np.float32(2**0.05)
    gathering = gathered([picture_of(TURNS[0]), brighter, picture_of(TURNS[2])], TURNS[:3])
    views = [ViewId(frame, "cam") for frame in range(3)]
    differences = seams(views, gathering.compared, LUMINANCE)
    assert [(seam.one.frame, seam.other.frame) for seam in differences] == [(0, 1), (1, 2)]
    assert differences[0].stops == pytest.approx(-0.05, abs=2e-3)
    assert differences[1].stops == pytest.approx(0.05, abs=2e-3)


def sunny(at: float) -> tuple[np.ndarray, np.ndarray]:
    """Directions, and where a sun of 4 degrees stands at a longitude (degrees) and latitude 30."""
    every = directions(ROWS, 0, ROWS)
    turn = np.radians(at)
    ahead = np.array([np.cos(np.pi / 6) * np.sin(turn), 0.5, np.cos(np.pi / 6) * np.cos(turn)])
    return every, every @ ahead > np.cos(np.radians(4))


@pytest.mark.parametrize("at", [60.0, 180.0], ids=["inside", "at both ends"])
def test_the_sun_has_what_a_card_gets_beside_the_rest(at: float) -> None:
    every, inside = sunny(at)
    result = gathered([picture_of(turn) for turn in TURNS], TURNS).result()
    result.light[inside], result.mask[inside] = 50.0, CLIPPED
    regions, brightest = clipped_regions(result, LUMINANCE)
    assert len(regions) == 1
    assert (brightest == inside).all()
    region = regions[0]
    assert np.cos(np.radians(region.longitude - at)) > 0.9999
    assert region.latitude == pytest.approx(30, abs=0.5)
    assert region.width == pytest.approx(8, abs=0.5)
    lit, recovered = with_sun(result, (region, brightest), 200.0, LUMINANCE)
    card = np.array(
        [
            np.cos(np.radians(region.latitude)) * np.sin(np.radians(region.longitude)),
            np.sin(np.radians(region.latitude)),
            np.cos(np.radians(region.latitude)) * np.cos(np.radians(region.longitude)),
        ]
    )
    facing = np.clip(every @ card, 0, None) * solid_angles(ROWS)
    assert float(((lit.light @ LUMINANCE) * facing).sum()) == pytest.approx(200.0, rel=1e-5)
    assert recovered.luminance == pytest.approx(float(lit.light[inside][0, 1]))
    assert (lit.mask[inside] == CLIPPED | RECOVERED).all()
    with pytest.raises(InputError, match=r"gets .* lx already"):
        with_sun(result, (region, brightest), 5.0, LUMINANCE)


def test_what_no_view_shows_of_the_light_on_a_card_is_said() -> None:
    _, inside = sunny(0.0)
    result = gathered([picture_of(turn) for turn in TURNS], TURNS).result()
    result.mask[inside] = CLIPPED
    region = clipped_regions(result, LUMINANCE)[0][0]
    assert share_unseen(result, region) == 0
    result.mask[ROWS // 2 :] = NOTHING  # below the horizon: of a card that is tilted by 30 degrees a quarter
    assert share_unseen(result, region) == pytest.approx(0.25, abs=0.01)


def test_many_saturated_places_take_no_mask_each() -> None:
    rows, rng = 256, np.random.default_rng(0)
    result = Map(np.ones((rows, 2 * rows, 3), np.float32), None, np.zeros((rows, 2 * rows), np.int64))
    places = np.zeros_like(result.mask)
    places[::2, ::2] = rng.uniform(size=(rows // 2, rows)) < 0.3
    result.mask[places > 0], result.light[places > 0] = CLIPPED, 50.0
    result.light[100, 200], result.mask[100, 200] = 900.0, CLIPPED
    tracemalloc.start()
    regions, brightest = clipped_regions(result, LUMINANCE)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(regions) >= places.sum() > 5000
    assert peak < 100 * result.mask.size
    assert np.argwhere(brightest).tolist() == [[100, 200]]
    energies = [region.illuminance for region in regions]
    assert energies == sorted(energies, reverse=True)
    angles = np.broadcast_to(solid_angles(rows), places.shape)
    assert sum(region.solid_angle for region in regions) == pytest.approx(angles[result.mask > 0].sum())
