"""Two yards against the sun: their light spans what they are for, and lies where it should."""

import numpy as np
import pytest

from . import yards
from .lit import LitScene

pytest.importorskip("mitsuba")

SUNS = {"low-sun": yards.LOW, "high-sun": yards.HIGH}


@pytest.fixture(scope="module", params=[yards.low_sun, yards.high_sun], ids=list(SUNS))
def yard(request: pytest.FixtureRequest) -> LitScene:
    made: LitScene = request.param(views=6, width=80, samples=4, traced=16)
    return made


def test_the_light_spans_twenty_stops(yard: LitScene) -> None:
    light = yard.light()
    assert light.max() / np.percentile(light, 0.1) > 2**20


def test_the_sun_is_hidden_from_some_views(yard: LitScene) -> None:
    """Above half its radiance, since a pixel at its edge shows less."""
    sunlit = (yard.light().max(-1) > yards.SUN / 2).any((1, 2))
    assert 0 < sunlit.sum() < len(sunlit)


def test_the_room_is_dark_and_seen_through_the_door(yard: LitScene) -> None:
    light, room = yard.light().mean(-1), yard.where("room")
    assert room.any((1, 2)).all()
    assert 0.01 < room.mean() < 0.1
    assert np.median(light[room]) < np.median(light[yard.where("ground", "front")]) / 8


def test_behind_everything_is_the_sky(yard: LitScene) -> None:
    """In the direction of each pixel; at edges of the yard and of the sun pixels show both."""
    height, width = yard.light().shape[1:3]
    y, x = np.mgrid[:height, :width] + 0.5
    rays = np.stack([x - width / 2, y - height / 2, np.full(x.shape, yard.focal)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    ratios = []
    for light, pose, far in zip(yard.light(), yard.poses, yard.where("background"), strict=True):
        sky = yards.sky_light(rays @ pose[:3, :3], *SUNS[yard.name])
        ratios.append((light / sky)[far])
    stops = np.abs(np.log2(np.concatenate(ratios)))
    assert np.median(stops) < 0.02
    assert np.percentile(stops, 95) < 0.25
