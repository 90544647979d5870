"""Layers of scenes whose surfaces are known in closed form."""

import numpy as np
import pytest

from imaging.optics.pose import Pose
from recon.data.geometry import rays
from recon.data.world import WorldTransform
from recon.result.data_layers import DataLayers
from recon.splat import SplatCamera
from tests.recon.rendering.scenes import LENS, axis_of, scene, sheet, shot, view

WORLD = WorldTransform(origin=(100.0, -50.0, 7.0), unit=2.5)


def directions(camera: SplatCamera) -> np.ndarray:
    """[H, W, 3] through the middles of the pixels, z = 1, in the camera's axes."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return rays(camera, np.stack([x, y], -1))


def placed(world: WorldTransform) -> SplatCamera:
    """Camera at the scene's origin, looking along its z axis."""
    return world.camera_in_world(view().splat_camera)


def test_depth_and_normal_of_a_tilted_surface() -> None:
    right, down = (3.0, 0.0, 0.9), (0.0, 3.0, -0.6)
    layers = DataLayers(scene(sheet((0, 0, 3), right, down, 1.0, 0.03), world=WORLD))
    camera = placed(WORLD)
    normal = axis_of(np.cross(right, down))
    depth = 2.5 * (normal @ (0, 0, 3)) / (directions(camera) @ normal)
    estimated = layers.depth(camera)
    assert np.abs(np.log(estimated / depth)).max() < 0.02
    # What is drawn first hides some of what is behind it: a third of a disc, of 0.03, nearer than the plane.
    assert np.abs(np.log(estimated / depth)).mean() < 0.008
    towards = -normal * np.sign(normal[2])
    np.testing.assert_allclose(layers.normal(camera), np.broadcast_to(towards, (*depth.shape, 3)), atol=1e-3)
    assert layers.alpha(camera).min() > 0.99


def test_depth_is_of_the_front_or_the_back_and_never_between() -> None:
    """A card before a wall: where both share pixels the mean depth would be at neither."""
    card = sheet((0.0, 0, 2), (0.5, 0, 0), (0, 0.5, 0), 1.0, 0.02)
    wall = sheet((0, 0, 6), (6, 0, 0), (0, 6, 0), 1.0, 0.1)
    depth = DataLayers(scene(card.joined(wall))).depth(view().splat_camera)
    assert set(np.round(depth, 2).ravel()) == {2.0, 6.0}
    across = (np.abs(directions(view().splat_camera)[..., :2]) * 2).max(-1)
    assert (depth[across < 0.45] < 3).all()
    assert (depth[across > 0.6] > 3).all()


def test_where_nothing_is_depth_is_infinite_and_the_rest_zero() -> None:
    card = sheet((0, 0, 2), (0.5, 0, 0), (0, 0.5, 0), 1.0, 0.02)
    layers, camera = DataLayers(scene(card)), view().splat_camera
    assert np.isinf(layers.depth(camera)[0, 0])
    assert layers.alpha(camera)[0, 0] == 0
    assert not layers.normal(camera)[0, 0].any()
    assert layers.trust(camera)[0, 0] == 0
    nothing = DataLayers(scene(card.__class__(card.rows(np.s_[:0]))))
    assert np.isinf(nothing.depth(camera)).all()
    assert not nothing.trust(camera).any()
    for name in ("depth", "alpha", "normal", "trust"):
        assert not np.isnan(nothing.layer(name, camera)).any()


def test_trust_counts_views_that_saw_and_measured() -> None:
    """Put a wall half behind a card: three see all of it, one from behind the card, one too dark, one
    away.
    """
    card = sheet((0.0, 0, 2), (0.4, 0, 0), (0, 2, 0), 1.0, 0.08)
    wall = sheet((0, 0, 6), (6, 0, 0), (0, 6, 0), 4.0, 0.1)
    beyond = Pose(quaternion=(1, 0, 0, 0), translation=(0, 0, -3))  # past the card
    back = Pose(quaternion=(0, 0, 1, 0), translation=(0, 0, 0))  # turned round
    views = (
        view("cam0", beyond),
        view("cam1", beyond),
        view("cam2", beyond, (shot(0, 0.1), shot(3, 5))),  # one of its bracket tells light of 4
        view("cam3"),  # before the card
        view("cam4", beyond, (shot(8, 100),)),  # 4 is below its noise
        view("cam5", beyond, (shot(0, 2),)),  # 4 is above its white
        view("cam6", back),
        view("cam7", beyond).model_copy(update={"use": "test"}),
    )
    layers = DataLayers(scene(card.joined(wall), views))
    reports = []
    layers = DataLayers(layers.scene, lambda what, done, total: reports.append((done, total)))
    camera = SplatCamera.of(LENS, beyond)
    trust = layers.trust(camera)
    x, y = np.moveaxis(directions(camera)[..., :2] * 3, -1, 0)
    # From the origin the card, 2 away, hides what is 6 away and three times as large.
    hidden, free = np.abs(x) < 1.0, np.abs(x) > 1.45
    for where, count in ((hidden, 3), (free, 4)):
        told_of = trust[where & (np.abs(y) < 1.2)]
        np.testing.assert_allclose(told_of, count, atol=0.45)
        assert told_of.mean() == pytest.approx(count, abs=0.1)
    assert reports[-1] == (7, 7)
    layers.trust(camera)
    assert len(reports) == 8, "counted once"
    card_seen = layers.trust(view().splat_camera)[:, 21:27]  # by one; a few of its discs hide behind others
    assert card_seen.mean() == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize("name", ["depth", "alpha", "normal", "trust"])
def test_layers_of_an_extreme_scene_are_numbers(name: str) -> None:
    gaussians = sheet((0, 0, 2), (0.5, 0, 0), (0, 0.5, 0), 1.0, 0.02)
    parameters = {key: value.clone() for key, value in gaussians.parameters.items()}
    parameters["log_scales"][:50] = 80.0
    parameters["log_scales"][50:90] = -200.0
    parameters["quats"][90:95] = 0.0
    parameters["opacity_logits"][100:120] = -500.0
    plane = DataLayers(scene(gaussians.__class__(parameters))).layer(name, view().splat_camera)
    assert not np.isnan(plane).any()
