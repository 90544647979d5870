"""Albedo of floors under known light, and that nothing is stated where light is not known."""

from dataclasses import replace

import numpy as np
import pytest

from imaging.errors import ReconstructionError
from imaging.session.records import Band
from recon.albedo.estimate import Albedo, albedo_of
from recon.result.model import DisplayValues
from recon.result.scene import Scene
from tests.recon.albedo.floors import around, floor, lit, middle, sky, upwards
from tests.recon.rendering.scenes import scene, sheet

LIGHT, REFLECTANCE = np.array([3.0, 2.0, 0.5]), np.array([0.4, 0.7, 0.1])


@pytest.fixture(autouse=True)
def _few_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("recon.albedo.estimate.PLACES", 60)


def under_sky(*, overhead: bool = True, far: bool = True) -> Scene:
    """A floor under an even sky, of which it reflects a share a channel."""
    ground = floor()
    light = np.tile(LIGHT * REFLECTANCE, (len(ground), 1))
    views = (*around(), *upwards()) if overhead else around()
    return scene(lit(ground, light), views, environment=sky(LIGHT) if far else None)


def nothing_known(albedo: Albedo) -> bool:
    return not albedo.known.any() and bool(
        np.isnan(albedo.albedo).all() and np.isnan(albedo.irradiance).all()
    )


def test_under_an_even_sky_it_is_what_is_reflected() -> None:
    given = under_sky()
    result, there = albedo_of(given), middle(given.gaussians)
    assert result.known[there].all()
    np.testing.assert_allclose(result.albedo[there], np.tile(REFLECTANCE, (there.sum(), 1)), rtol=0.01)
    np.testing.assert_allclose(result.irradiance[there], np.tile(np.pi * LIGHT, (there.sum(), 1)), rtol=0.01)
    assert (result.sigma[there] > 0).all()
    assert "standard error" in str(result)


def test_the_unit_of_the_light_does_not_matter() -> None:
    """Irradiance is in that of the scene."""
    given = under_sky()
    other = replace(given, record=given.record.model_copy(update={"normaliser": 8.0}))
    one, two = albedo_of(given), albedo_of(other)
    np.testing.assert_allclose(two.albedo, one.albedo)
    np.testing.assert_allclose(two.irradiance, 8 * one.irradiance)


def test_under_a_lamp_it_is_even_though_the_light_is_not() -> None:
    """A square lamp before the dark; its light falls by three quarters across the floor."""
    ground, lamp = floor(), sheet((0, 0, 1.5), (0.2, 0, 0), (0, 0.2, 0), 50.0, 0.025)
    side = (np.arange(40) + 0.5) / 100 - 0.2
    across = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    apart = ground.parameters["means"].numpy()[:, None, :2] - across
    falling = 50 * (1.5**2 / (1.5**2 + (apart**2).sum(-1)) ** 2).mean(1) * 0.4**2
    light = np.repeat(0.4 * falling[:, None] / np.pi, 3, axis=1)
    given = scene(lit(ground, light).joined(lamp), (*around(), *upwards()), environment=sky([1e-6] * 3))
    result, there = albedo_of(given), middle(ground)
    assert falling[there].max() > 2.5 * falling[there].min()
    stated = result.known[: len(ground)] & there
    assert stated.mean() > 0.9 * there.mean()
    albedo, error = result.albedo[: len(ground), 1], result.sigma[: len(ground)]
    assert np.median(albedo[stated]) == pytest.approx(0.4, rel=0.15)
    assert (np.abs(albedo - 0.4) < 2 * error)[stated].mean() > 0.9
    assert not result.known[len(ground) :].any()  # a lamp reflects nothing


def test_under_a_sky_that_no_view_saw_nothing_is_stated() -> None:
    assert nothing_known(albedo_of(under_sky(overhead=False)))


def test_without_a_sky_nothing_is_stated() -> None:
    result = albedo_of(under_sky(far=False))
    assert nothing_known(result)
    assert "of no Gaussian" in str(result)


def test_in_the_dark_nothing_is_stated() -> None:
    given = scene(
        lit(floor(), np.full((400, 3), 1e-20)), (*around(), *upwards()), environment=sky([1e-36] * 3)
    )
    assert nothing_known(albedo_of(given))


def test_what_shines_by_itself_has_no_albedo() -> None:
    """A floor brighter than the sky above it."""
    ground = floor()
    given = scene(
        lit(ground, np.full((len(ground), 3), 9.0)), (*around(), *upwards()), environment=sky(LIGHT)
    )
    assert nothing_known(albedo_of(given))


def test_one_view_says_too_little() -> None:
    given = under_sky()
    one = replace(given, record=given.record.model_copy(update={"views": given.views[:1]}))
    assert nothing_known(albedo_of(one))


def test_three_gaussians_are_no_surface() -> None:
    given = under_sky()
    few = replace(given, gaussians=type(given.gaussians)(given.gaussians.rows(np.s_[:3])))
    assert nothing_known(albedo_of(few))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"display": DisplayValues.model_construct()}, "display values"),
        ({"bands": (Band.model_construct(),)}, "bands"),
        ({"views": ()}, "no training views"),
    ],
)
def test_scenes_without_it_are_refused(changed: dict[str, object], words: str) -> None:
    given = under_sky()
    with pytest.raises(ReconstructionError, match=words):
        albedo_of(replace(given, record=given.record.model_copy(update=changed)))
