"""Cameras that move through a scene: where they have to be."""

import itertools
from collections.abc import Iterable
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imaging.errors import InputError
from imaging.optics.pose import Pose
from recon.rendering.cameras.camera_paths import named_path
from recon.rendering.request import RenderRequest
from recon.result.model import SceneView
from recon.result.scene import Scene
from recon.splat import SplatCamera
from tests.recon.rendering.scenes import scene, sheet, view

CARD = sheet((0, 0, 2), (0.5, 0, 0), (0, 0.5, 0), 1.0, 0.2)


def looking(place, target=(0.0, 0.0, 0.0), name: str = "cam0", frame: int = 0) -> SceneView:
    """A level camera at a place, z being up in the world."""
    z = np.subtract(target, place) / np.linalg.norm(np.subtract(target, place))
    x = np.cross(z, [0, 0, 1.0])
    x /= np.linalg.norm(x)
    turn = np.stack([x, np.cross(z, x), z])
    w, a, b, c = Rotation.from_matrix(turn).as_quat(scalar_first=True)
    pose = Pose(quaternion=(w, a, b, c), translation=tuple(-turn @ np.asarray(place, float)))
    return view(name, pose).model_copy(update={"frame": frame})


def ring(degrees, radius: float = 3.0, height: float = 1.0) -> tuple[SceneView, ...]:
    angles = np.radians(degrees)
    return tuple(
        looking((radius * np.cos(turn), radius * np.sin(turn), height), frame=number)
        for number, turn in enumerate(angles)
    )


def centre(camera: SplatCamera) -> np.ndarray:
    return -camera.cam_from_world[:3, :3].T @ camera.cam_from_world[:3, 3]


def path(views: tuple[SceneView, ...], text: str) -> tuple[SplatCamera, ...]:
    named = named_path(scene(CARD, views), text)
    assert named is not None
    return named.cameras


def test_an_orbit_goes_round_what_the_views_surround() -> None:
    cameras = path(ring(range(0, 360, 45)), "orbit:36")
    places = np.array([centre(camera) for camera in cameras])
    np.testing.assert_allclose(np.hypot(places[:, 0], places[:, 1]), 3, atol=1e-6)
    np.testing.assert_allclose(places[:, 2], 1, atol=1e-6)
    steps = np.degrees(np.diff(np.unwrap(np.arctan2(places[:, 1], places[:, 0]))))
    np.testing.assert_allclose(np.abs(steps), 10, atol=1e-6)
    for camera, place in zip(cameras, places, strict=True):
        ahead = -place / np.linalg.norm(place)
        np.testing.assert_allclose(camera.cam_from_world[2, :3], ahead, atol=1e-6)
        assert camera.cam_from_world[0, 2] == pytest.approx(0, abs=1e-6)  # level
        assert camera.cam_from_world[1, 2] < 0  # and not upside down
        assert np.linalg.det(camera.cam_from_world[:3, :3]) == pytest.approx(1)


@pytest.mark.parametrize("text", ["orbit:12", "spline:12"])
@pytest.mark.parametrize("degrees", [range(0, 320, 40), (170, 185, 200)], ids=["ring", "one side"])
@pytest.mark.parametrize(("orientation", "roll"), [(6, 90), (8, -90), (3, 180)])
@pytest.mark.parametrize("first", [0, 2], ids=["all", "after two that lie"])
def test_a_path_is_upright_however_the_camera_was_held(
    text: str, degrees: Iterable[float], orientation: int, roll: float, first: int
) -> None:
    views, aside = list(ring(degrees)), Rotation.from_euler("z", -roll, degrees=True)
    for number, one in list(enumerate(views))[first:]:
        turn = aside * Rotation.from_quat(one.cam_from_world.quaternion, scalar_first=True)
        w, x, y, z = turn.as_quat(scalar_first=True)
        a, b, c = aside.apply(one.cam_from_world.translation)
        pose = Pose(quaternion=(w, x, y, z), translation=(a, b, c))
        views[number] = one.model_copy(update={"cam_from_world": pose, "orientation": orientation})
    lens = views[0].lens
    shape = (lens.height, lens.width) if orientation != 3 and not first else (lens.width, lens.height)
    for camera, level in zip(path(tuple(views), text), path(ring(degrees), text), strict=True):
        np.testing.assert_allclose(camera.cam_from_world, level.cam_from_world, atol=1e-9)
        assert (camera.width, camera.height) == shape
    held, level_up = (Scene.up.fget(SimpleNamespace(views=one)) for one in (views, ring(degrees)))
    np.testing.assert_allclose(held, level_up, atol=1e-9)


def test_an_orbit_of_views_from_one_side_stays_there() -> None:
    places = np.array([centre(camera) for camera in path(ring((170, 185, 200)), "orbit:50")])
    angles = np.degrees(np.arctan2(places[:, 1], places[:, 0])) % 360
    assert angles.min() == pytest.approx(170, abs=1e-4)
    assert angles.max() == pytest.approx(200, abs=0.1)
    assert abs(angles[-1] - angles[0]) < 0.2  # it can be repeated


def test_a_spline_leads_through_the_places_of_the_views() -> None:
    views = (
        looking((3, 0, 1), frame=0),
        looking((2, 2, 1.5), frame=1),
        looking((2, 2, 1.5), frame=2),  # it stood still
        looking((0, 3, 0.5), frame=3),
        looking((-3, 0.5, 1), frame=4),
    )
    cameras = path((*views, looking((9, 9, 9), name="cam1")), "spline:2001")
    places = np.array([centre(camera) for camera in cameras])
    for one in views:
        camera = one.splat_camera
        away = np.linalg.norm(places - centre(camera), axis=1)
        nearest = int(away.argmin())
        assert away[nearest] < 0.005
        turn = cameras[nearest].cam_from_world[:3, :3] @ camera.cam_from_world[:3, :3].T
        assert np.degrees(Rotation.from_matrix(turn).magnitude()) < 0.3
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert speed.max() < 1.1 * speed.min()
    assert np.abs(np.diff(places, 2, axis=0)).max() < 0.05 * speed.mean()  # no corner
    turned = [Rotation.from_matrix(camera.cam_from_world[:3, :3]) for camera in cameras]
    rates = np.array([(b * a.inv()).magnitude() for a, b in itertools.pairwise(turned)])
    assert np.abs(np.diff(rates)).max() < 0.1 * rates.max()


def test_of_a_rig_that_stood_still_the_spline_goes_from_camera_to_camera() -> None:
    views = tuple(
        one.model_copy(update={"camera": f"cam{i}", "frame": 0}) for i, one in enumerate(ring((0, 30, 60)))
    )
    places = [centre(camera) for camera in path(views, "spline:3")]
    np.testing.assert_allclose(places[0], centre(views[0].splat_camera), atol=1e-9)
    np.testing.assert_allclose(places[-1], centre(views[-1].splat_camera), atol=1e-9)


@pytest.mark.parametrize("text", ["orbit", "spline", "orbit:1", "spline:1"])
def test_two_views_and_one_frame_will_do(text: str) -> None:
    cameras = path(ring((0, 40)), text)
    assert len(cameras) == (120 if ":" not in text else 1)
    assert all(np.isfinite(camera.cam_from_world).all() for camera in cameras)


@pytest.mark.parametrize("text", ["orbit:0", "spline:-3", "orbit:x", "spline:", "orbit:1000000"])
def test_a_number_of_frames_that_cannot_be_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="is not a path"):
        path(ring((0, 40)), text)


@pytest.mark.parametrize("text", ["orbit:0", "kreis"])
def test_a_path_that_cannot_be_is_refused_before_a_scene_is_loaded(text: str) -> None:
    with pytest.raises(InputError, match="is not a path"):
        RenderRequest(path=text)


@pytest.mark.parametrize("text", ["orbit", "spline"])
def test_views_from_one_place_have_no_path(text: str) -> None:
    once = looking((3, 0, 1))
    with pytest.raises(InputError, match="have the same position"):
        path((once, once.model_copy(update={"frame": 1})), text)


def test_other_words_are_names_of_files() -> None:
    assert named_path(scene(CARD), "orbits/shot.csv") is None
