"""Start of training, against the simulator's true surfaces."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.support import oracle
from drivers.sim.scene.tabletop import demo_scene
from imaging.errors import ReconstructionError
from recon.data.geometry import lift, project, rays
from recon.data.light import BRIGHTEST, light_of, radiance_image
from recon.measure.truth import true_radiance
from recon.scene.appearance import LuminanceChromaticity
from recon.splat import SplatCamera
from recon.start.initialisation import colours_at, gaussians_at, start_points
from recon.start.plane_sweep import plane_sweep, spread

LENS = SplatCamera(
    np.eye(4) + np.array([[0, 0, 0, 0.3], [0, 0, 0, -0.2], [0, 0, 0, 1.0], [0, 0, 0, 0]]),
    310.0, 305.0, 161.0, 118.0, 320, 240, k1=-0.12, k2=0.03, p1=0.002, p2=-0.001,
)  # fmt: skip
FISHEYE = replace(
    LENS, fx=150.0, fy=151.0, k1=0.03, k2=-0.01, k3=0.004, k4=-0.001, p1=0.0, p2=0.0, fisheye=True
)


def ring_view(angle: float) -> SimpleNamespace:
    """A view of the origin from a distance of 1."""
    ahead = -np.array([np.cos(angle), np.sin(angle), 0.0])
    motion = np.eye(4)
    motion[:3, :3] = np.stack([np.cross([0, 0, -1.0], ahead), [0, 0, -1.0], ahead])
    motion[:3, 3] = motion[:3, :3] @ ahead
    return SimpleNamespace(centre=-ahead, lens=replace(LENS, cam_from_world=motion))


@pytest.fixture(scope="module")
def images(toy_dataset):
    return [radiance_image(view) for view in toy_dataset.train]


def true_depth(dataset, view, pixels):
    motion = view.lens.cam_from_world
    directions = rays(view.lens, pixels) @ motion[:3, :3]
    origin = np.broadcast_to(dataset.world.to_world(view.centre), directions.shape)
    lengths = np.linalg.norm(directions, axis=-1)
    return demo_scene().depth(origin, directions) / (lengths * dataset.world.unit)


@pytest.mark.parametrize("lens", [LENS, FISHEYE])
def test_pixels_to_points_and_back_through_a_distorted_lens(lens):
    x, y = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    pixels = np.stack([x, y], -1)
    depth = np.random.default_rng(0).uniform(0.5, 9, pixels.shape[:2])
    projected, at = project(lens, lift(lens, pixels, depth))
    np.testing.assert_allclose(projected, pixels, atol=1e-6)
    np.testing.assert_allclose(at, depth, rtol=1e-12)


@pytest.mark.parametrize("lens", [LENS, FISHEYE])
def test_projection_is_that_of_the_rasteriser(lens):
    points = np.random.default_rng(1).uniform((-1, -1, 1), (1, 1, 3), (50, 3))
    projected, _ = project(lens, points)
    camera = points @ lens.cam_from_world[:3, :3].T + lens.cam_from_world[:3, 3]
    tangents = lens.distort(camera[:, :2] / camera[:, 2:])
    np.testing.assert_allclose(projected, tangents * [lens.fx, lens.fy] + [lens.cx, lens.cy], rtol=1e-12)


def test_a_fisheye_folds_nothing_back_into_the_image():
    """Terms that fit an image may fold far outside it: what lies there projects outside too."""
    lens = replace(FISHEYE, k1=-0.1, k2=-0.05, k3=-0.01, k4=0.0, cam_from_world=np.eye(4))
    angles = np.linspace(0.0, 1.57, 50)
    pixels, _ = project(lens, np.stack([np.sin(angles), 0 * angles, np.cos(angles)], 1))
    assert (np.diff(pixels[:, 0]) > -1e-9).all()
    assert lens.distort(np.array([np.tan(1.5), 0.0]))[0] * lens.fx + lens.cx < pixels[-1, 0] - 10


def test_merged_radiance_is_near_the_truth(toy_dataset, images):
    for view, (rgb, trusted) in zip(toy_dataset.train, images, strict=True):
        truth = true_radiance(toy_dataset.session, view)
        assert trusted.mean() > 0.99
        ratio = np.log2(np.maximum(rgb, 1e-6)[trusted] / truth[trusted])
        assert abs(np.median(ratio)) < 0.05
        assert np.percentile(np.abs(ratio), 60) < 0.5


def test_light_of_the_scene(toy_dataset, images):
    light = light_of(toy_dataset, images)
    brightest = max(true_radiance(toy_dataset.session, view).max() for view in toy_dataset.train)
    assert 0.3 * brightest < light.normaliser < 3 * brightest
    longest = max(shot.k for shot in toy_dataset.train[0].shots)
    # A code value of the longest exposure, or 2^-20 where that is less.
    assert light.reference == pytest.approx(max(1 / 4095 / longest / light.normaliser, 2.0**-20))


def test_the_brightest_light_is_the_quantile_of_all_pixels_together(toy_dataset) -> None:
    """Of images that grow brighter, and of some that show nothing in a channel, or in all of them."""
    rng = np.random.default_rng(4)
    made = [
        (rng.lognormal(turn % 5, 2, (view.lens.height, view.lens.width, 3)).astype(np.float32), None)
        for turn, view in enumerate(toy_dataset.train)
    ]
    made[1][0][..., 1] = np.nan
    together = np.concatenate([np.nanmax(light, -1).ravel() for light, _ in made])
    assert light_of(toy_dataset, made).normaliser == np.quantile(together.astype(np.float64), BRIGHTEST)


def test_swept_depth_is_the_true_one_at_most_pixels(toy_dataset, images):
    points = toy_dataset.points().xyz
    maps = plane_sweep(toy_dataset.train, images, points)
    assert len(maps) == len(toy_dataset.train)
    for depth_map in maps:
        error = np.abs(depth_map.depth / true_depth(toy_dataset, depth_map.view, depth_map.centres) - 1)
        assert np.isfinite(depth_map.depth).all()
        assert np.median(error) < 0.06
        if depth_map.trusted.any():
            assert np.median(error[depth_map.trusted]) < 0.04


def test_start_has_the_number_asked_for_and_the_colours_of_the_views(toy_dataset, images):
    start = start_points(toy_dataset, images, 700, np.random.Generator(np.random.PCG64(3)))
    assert 600 <= len(start.xyz) <= 700
    assert 250 <= start.sparse <= 300
    assert (start.rgb >= 0).all()
    again = start_points(toy_dataset, images, 700, np.random.Generator(np.random.PCG64(3)))
    np.testing.assert_array_equal(start.xyz, again.xyz)

    gaussians = gaussians_at(start, LuminanceChromaticity(), lambda light: light / 100)
    assert len(gaussians) == len(start.xyz)
    scales = gaussians.scales().numpy()
    assert (scales > 0).all()
    assert scales.max() <= 64 * scales.min() * 1.001


def test_nothing_starts_in_the_empty_space_before_a_black_background(toy_dataset, images):
    """Start nothing at the guessed depth of black pixels: Gaussians there would hide what is lit behind
    them.
    """

    def before_black(view, rgb):
        pixels = np.stack(np.meshgrid(*(np.arange(size) + 0.5 for size in rgb.shape[1::-1])), -1)
        depth = true_depth(toy_dataset, view, pixels)
        return np.where((depth > np.median(depth))[..., None], 0, rgb)

    black = [
        (before_black(view, rgb), trusted)
        for view, (rgb, trusted) in zip(toy_dataset.train, images, strict=True)
    ]
    start = start_points(toy_dataset, black, 2000, np.random.Generator(np.random.PCG64(3)))
    swept = start.rgb[start.sparse :]
    assert len(swept) > 500
    assert (swept.max(-1) <= 0).mean() < 0.02


def test_colours_forgive_what_is_covered_in_a_few_views(toy_dataset, images):
    view = toy_dataset.train[0]
    pixels = np.array([[32.5, 20.5], [12.5, 40.5]])
    points = lift(view.lens, pixels, true_depth(toy_dataset, view, pixels))
    behind = np.array([[0.0, 0, 500.0]]) @ view.lens.cam_from_world[:3, :3]
    rgb, visible = colours_at(toy_dataset, images, np.concatenate([points, view.centre - behind]))
    assert visible[:2].all()
    truth = true_radiance(toy_dataset.session, view)[[20, 40], [32, 12]]
    assert (np.abs(np.log2(rgb[:2] / truth)) < 1.5).all()


def test_too_few_points_are_refused(toy_dataset, images, session_copy):
    from recon.data.load import load

    (session_copy / "calibration" / "calibration.json").unlink()
    oracle.calibrate_from_truth(session_copy, points=4)
    with pytest.raises(ReconstructionError, match="4 scene points"):
        start_points(load(session_copy), images, 100, np.random.default_rng(0))


def test_of_many_views_some_are_swept_from_everywhere_with_one_that_confirms_each():
    """Views on a ring that look inwards, three hundred of them."""
    angles = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    views = tuple(ring_view(angle) for angle in angles)
    chosen = spread(views, 48)
    assert len(chosen) == 48
    assert chosen == sorted(set(chosen))
    gaps = np.diff([*chosen, chosen[0] + 300])
    assert gaps.max() < 3 * 300 / 24
    assert (np.minimum(gaps, np.roll(gaps, 1)) == 1).all()
    assert spread(views[:48], 48) == list(range(48))
    assert len(spread(views[:1] * 60, 48)) < 3


def test_points_are_coloured_the_same_in_parts(toy_dataset, images, monkeypatch):
    xyz = toy_dataset.points().xyz
    whole = colours_at(toy_dataset, images, xyz)
    monkeypatch.setattr("recon.start.initialisation.SAMPLES_AT_ONCE", 40 * len(images))
    for together, apart in zip(whole, colours_at(toy_dataset, images, xyz), strict=True):
        np.testing.assert_array_equal(together, apart)


def test_depth_between_textures_is_believed_where_views_agree(toy_dataset, images):
    """Wrong more often than where texture tells it, and nearer to the truth than what no view confirms."""
    maps = plane_sweep(toy_dataset.train, images, toy_dataset.points().xyz)
    errors = {"trusted": [], "believed": [], "else": []}
    for depth_map in maps:
        error = np.abs(depth_map.depth / true_depth(toy_dataset, depth_map.view, depth_map.centres) - 1)
        assert not (depth_map.trusted & ~depth_map.believed).any()
        errors["trusted"].append(error[depth_map.trusted])
        errors["believed"].append(error[depth_map.believed & ~depth_map.trusted])
        errors["else"].append(error[~depth_map.believed])
    trusted, believed, others = (np.concatenate(part) for part in errors.values())
    assert min(len(trusted), len(believed), len(others)) > 100
    assert np.median(trusted) < np.median(believed) < np.median(others)
