"""The ray-caster against analytic intersections and the rendering equation written out by hand."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from drivers.sim.camera.lens import project, unproject
from drivers.sim.mounting import look_at
from drivers.sim.scene.gallery import gallery_scene
from drivers.sim.scene.scene import Builder, Scene
from drivers.sim.scene.tabletop import TARGET, demo_scene
from drivers.sim.scene.texture import MOTTLE
from imaging.optics.lens import Lens

GREY = (0.5, 0.4, 0.3)
LENS = Lens(
    model="OPENCV", width=64, height=48, fx=64, fy=64, cx=32.2, cy=23.7, k1=-0.07, k2=2e-3, p1=1e-4, p2=-1e-4
)


def grey(build: Builder, **options: float) -> int:
    """A material without texture."""
    return build.material(MOTTLE, 1.0, GREY, detail=0.0, **options)


def rays(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-6, 6, (count, 3))
    origins[np.linalg.norm(origins, axis=1) < 3] *= 4
    directions = rng.uniform(-1, 1, (count, 3)) - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def only(build: Builder) -> Scene:
    return build.scene((1.0, 1.0, 1.0))


def test_depth_of_a_sphere_is_analytic() -> None:
    build = Builder()
    centre, radius = np.array((0.3, -0.2, 0.1)), 0.8
    build.sphere(grey(build), tuple(centre), radius)
    o, d = rays(4000)
    b = ((o - centre) * d).sum(1)
    gap = b * b - ((o - centre) ** 2).sum(1) + radius**2
    expected = np.where(gap >= 0, -b - np.sqrt(np.maximum(gap, 0)), np.inf)
    expected[expected < 0] = np.inf
    depth = only(build).depth(o, d)
    assert 500 < np.isfinite(expected).sum() < 4000
    np.testing.assert_allclose(depth, expected, rtol=1e-11)
    inside = only(build).depth(centre, d)
    np.testing.assert_allclose(inside, radius, rtol=1e-12)


def test_depth_of_a_turned_box_is_analytic() -> None:
    build = Builder()
    centre, size, turn = np.array((0.2, 0.1, -0.3)), np.array((1.0, 0.6, 0.8)), 33.0
    build.box(grey(build), tuple(centre), tuple(size), turn=turn)
    o, d = rays(4000, 1)
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    local = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    a, e = (o - centre) @ local.T, d @ local.T
    # The six planes one by one: a hit counts where it lies on the face.
    best = np.full(len(o), np.inf)
    for axis in range(3):
        for side in (-0.5, 0.5):
            t = (side * size[axis] - a[:, axis]) / e[:, axis]
            at = a + t[:, None] * e
            others = [k for k in range(3) if k != axis]
            on = np.all(np.abs(at[:, others]) <= size[others] / 2, axis=1) & (t > 0)
            best = np.where(on & (t < best), t, best)
    assert 500 < np.isfinite(best).sum() < 4000
    np.testing.assert_allclose(only(build).depth(o, d), best, rtol=1e-9)


def test_depth_of_a_cylinder_is_analytic() -> None:
    build = Builder()
    centre, radius, height = np.array((-0.1, 0.2, 0.0)), 0.5, 1.4
    build.cylinder(grey(build), tuple(centre), radius, height)
    o, d = rays(4000, 2)
    a = o - centre
    best = np.full(len(o), np.inf)
    aa, bb = (d[:, :2] ** 2).sum(1), (a[:, :2] * d[:, :2]).sum(1)
    gap = bb * bb - aa * ((a[:, :2] ** 2).sum(1) - radius**2)
    t = (-bb - np.sqrt(np.maximum(gap, 0))) / aa
    best = np.where((gap >= 0) & (t > 0) & (np.abs(a[:, 2] + t * d[:, 2]) <= height / 2), t, best)
    for side in (-height / 2, height / 2):
        t = (side - a[:, 2]) / d[:, 2]
        on = ((a[:, :2] + t[:, None] * d[:, :2]) ** 2).sum(1) <= radius**2
        best = np.where(on & (t > 0) & (t < best), t, best)
    assert 500 < np.isfinite(best).sum() < 4000
    np.testing.assert_allclose(only(build).depth(o, d), best, rtol=1e-9)


def test_a_room_is_closed_and_every_wall_has_its_material() -> None:
    build = Builder()
    shades = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    walls = [build.material(MOTTLE, 1.0, (s, s, s), detail=0.0) for s in shades]
    low, high = np.array((-1.0, -2.0, 0.0)), np.array((3.0, 1.0, 2.5))
    build.room(tuple(walls), tuple(low), tuple(high))
    scene = only(build)
    rng = np.random.default_rng(5)
    o, d = rng.uniform(low, high, (3000, 3)), rng.normal(size=(3000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    exits = (np.where(d > 0, high, low) - o) / d
    axis = exits.argmin(axis=1)
    np.testing.assert_allclose(scene.depth(o, d), exits.min(axis=1), rtol=1e-9)
    expected = np.array(shades)[2 * axis + (d[np.arange(3000), axis] > 0)]
    # Ambient light only, dimmed alike in all colours towards the corners.
    open_wall = scene.radiance((1.0, -0.5, 1.2), np.array((1.0, 0.0, 0.0)))
    np.testing.assert_allclose(open_wall, 0.2, rtol=1e-9)
    ratio = scene.radiance(o, d)[:, 0] / expected
    assert np.all((ratio > 0.2) & (ratio <= 1.0 + 1e-9))


def lit_floor(*, blocker: bool = False, **options: float) -> Scene:
    build = Builder()
    build.box(grey(build, **options), (0, 0, -0.5), (40, 40, 1))
    if blocker:
        build.sphere(grey(build), (0, 0, 1.0), 0.3)
    build.light((0.0, 0.0, 2.0), (8.0, 6.0, 4.0))
    return build.scene((0.0, 0.0, 0.0))


def test_lambert_radiance_is_the_formula() -> None:
    scene = lit_floor()
    for x, y in ((0.0, 0.0), (1.0, -0.5), (3.0, 2.0)):
        square = x * x + y * y + 4.0
        expected = np.array(GREY) / math.pi * np.array((8.0, 6.0, 4.0)) * (2.0 / math.sqrt(square)) / square
        for eye in ((0.5, 0.5, 3.0), (-2.0, 1.0, 0.7)):
            got = scene.radiance(eye, np.array((x, y, 0.0)) - eye)
            np.testing.assert_allclose(got, expected, rtol=1e-5)


def test_shadows_are_hard_and_where_they_belong() -> None:
    scene = lit_floor(blocker=True)
    # Seen from the lamp the ball of radius 0.3 at distance 1 covers a cone of sine 0.3.
    edge = 2.0 * 0.3 / math.sqrt(1 - 0.09)
    eye = np.array((4.0, 0.0, 0.3))
    for angle in np.linspace(0, 2 * math.pi, 12):
        for factor, dark in ((0.999, True), (1.001, False)):
            at = np.array((math.cos(angle), math.sin(angle), 0.0)) * edge * factor
            start = at + np.array((0.0, 0.0, 0.4))  # close above, under the ball
            assert (scene.radiance(start, at - start)[0] == 0.0) == dark
    assert scene.radiance(eye, np.array((3.0, 0.0, 0.0)) - eye)[0] > 0


def test_gloss_adds_a_normalised_lobe_where_the_mirror_would_be() -> None:
    matte, glossy = lit_floor(), lit_floor(gloss=0.1, sharpness=50.0)
    eye, at = np.array((2.0, 0.0, 2.0)), np.array((1.0, 0.0, 0.0))  # mirror of the lamp
    extra = glossy.radiance(eye, at - eye) - matte.radiance(eye, at - eye)
    cosine, square = 2.0 / math.sqrt(5.0), 5.0
    peak = 0.1 * 58.0 / (8 * math.pi) * cosine / square * np.array((8.0, 6.0, 4.0))
    np.testing.assert_allclose(extra, peak, rtol=1e-5)
    aside = np.array((0.0, 2.0, 2.0))
    off = glossy.radiance(aside, at - aside) - matte.radiance(aside, at - aside)
    assert np.all(off < 0.2 * peak)


def camera_rays(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pose, origin and unit directions [H, W, 3] of a camera before the demo scene."""
    a = math.radians(225 + angle)
    pose = look_at((2.3 * math.cos(a), 2.3 * math.sin(a), 1.35), TARGET)
    v, u = np.mgrid[0 : LENS.height, 0 : LENS.width] + 0.5
    directions = unproject(LENS, np.stack([u, v], axis=-1)) @ pose[:3, :3]
    return pose, np.linalg.inv(pose)[:3, 3], directions


@pytest.mark.parametrize("made", [demo_scene, gallery_scene])
def test_every_ray_of_a_scene_ends_on_something_finite(made: Callable[[], Scene]) -> None:
    scene = made()
    o = np.random.default_rng(3).normal(size=(20_000, 3))
    start = np.array((-1.5, -1.5, 1.3))
    assert np.all(np.isfinite(scene.depth(start, o)))
    colour = scene.radiance(start, o)
    assert np.all(np.isfinite(colour))
    assert np.all(colour > 0)


@pytest.mark.parametrize(("made", "stops"), [(demo_scene, 17.7), (gallery_scene, 14.0)])
def test_a_view_spans_the_stops_that_its_scene_is_made_for(made: Callable[[], Scene], stops: float) -> None:
    scene = made()
    _, eye, directions = camera_rays(0.0)
    light = np.sort(scene.radiance(eye, directions).max(-1), axis=None)
    assert np.log2(light[-1] / light[len(light) // 1000]) == pytest.approx(stops, abs=0.5)


def test_lambertian_points_look_the_same_from_everywhere() -> None:
    scene = demo_scene()
    _, eye, directions = camera_rays(-8.0)
    _, other, _ = camera_rays(10.0)
    _, depth, which = scene._trace(eye, directions)
    points = eye + depth[..., None] * directions
    matte = (scene.materials["gloss"] == 0)[scene.solids["material"][which]]
    distance = np.linalg.norm(points - other, axis=-1)
    visible = np.abs(scene.depth(other, points - other) - distance) < 1e-6
    compared = matte & visible
    assert compared.mean() > 0.6
    first, second = scene.radiance(eye, directions), scene.radiance(other, points - other)
    same = np.all(np.isclose(first, second, rtol=1e-6), axis=-1)
    # A point on the very line of a shadow may fall to either side.
    assert same[compared].mean() > 0.998
    assert not np.all(same[visible & ~matte])


def test_a_point_projects_to_the_pixel_whose_ray_hits_it() -> None:
    scene = demo_scene()
    pose, eye, directions = camera_rays(5.0)
    points = eye + scene.depth(eye, directions)[..., None] * directions
    pixels = project(LENS, points @ pose[:3, :3].T + pose[:3, 3])
    v, u = np.mgrid[0 : LENS.height, 0 : LENS.width] + 0.5
    np.testing.assert_allclose(pixels, np.stack([u, v], axis=-1), atol=1e-8)


def test_a_rendered_pixel_is_the_mean_over_its_area() -> None:
    scene = demo_scene()
    pose, eye, _ = camera_rays(0.0)
    image = scene.render(LENS, pose, samples=4)
    assert image.dtype == np.float32
    offsets = (np.arange(4) + 0.5) / 4
    for row, column in ((0, 0), (10, 30), (20, 40), (25, 33), (40, 12), (47, 63)):
        v, u = np.meshgrid(row + offsets, column + offsets, indexing="ij")
        directions = unproject(LENS, np.stack([u, v], axis=-1)) @ pose[:3, :3]
        expected = scene.radiance(eye, directions).mean(axis=(0, 1))
        np.testing.assert_allclose(image[row, column], expected, rtol=1e-5)


@pytest.mark.parametrize("factor", [0.0, 2.0, 1e6])
def test_brightening_scales_everything(factor: float) -> None:
    scene = demo_scene()
    _, eye, directions = camera_rays(0.0)
    np.testing.assert_allclose(
        scene.brightened(factor).radiance(eye, directions),
        factor * scene.radiance(eye, directions),
        rtol=1e-9,
        atol=1e-290,
    )
