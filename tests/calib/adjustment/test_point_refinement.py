"""Patches of a plane whose texture is known everywhere, in views whose poses are known."""

from typing import Any

import cv2
import numpy as np

from calib.adjustment.point_refinement import refine_points
from imaging.files.colmap import pycolmap
from imaging.progress import unreported
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL = 200, 150, 200.0
VIEWS = tuple(ViewId(frame, "cam") for frame in range(3))
RNG = np.random.default_rng(3)
WAVES = RNG.normal(0, 30.0, (60, 2))  # per unit of the plane, which is 40 px wide
PHASES = RNG.uniform(0, 2 * np.pi, 60)


def pose(number: int) -> np.ndarray:
    """cam_from_world [3, 4]: 5 units before the plane z = 0, 20 degrees from view to view."""
    turn = cv2.Rodrigues(np.array([0.03 * number, np.radians(20.0 * (number - 1)), 0.05 * number]))[0]
    return np.column_stack([turn, (0.05 * number, 0.0, 5.0)])


def picture(number: int, noise: float) -> bytes:
    motion = pose(number)
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack([(x - WIDTH / 2) / FOCAL, (y - HEIGHT / 2) / FOCAL, np.ones_like(x)], -1) @ motion[:, :3]
    centre = -motion[:, :3].T @ motion[:, 3]
    places = centre[:2] - rays[..., :2] * (centre[2] / rays[..., 2:])
    light = np.cos(places @ WAVES.T / 3 + PHASES).mean(-1)
    light = 128 + (250 + 60 * number) * light + RNG.normal(0, noise, light.shape)
    return cv2.imencode(".png", np.clip(np.rint(light), 0, 255).astype(np.uint8))[1].tobytes()


def model(points: np.ndarray) -> tuple[Any, dict[int, np.ndarray]]:
    """Three views of points [N, 3], and where the points lie in each."""
    made = pycolmap.Reconstruction()
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", FOCAL, WIDTH, HEIGHT)
    made.add_camera_with_trivial_rig(camera)
    places = {}
    for number, view in enumerate(VIEWS):
        motion = pose(number)
        places[number + 1] = camera.img_from_cam(points @ motion[:, :3].T + motion[:, 3])
        image = pycolmap.Image(
            name=view.image_name, keypoints=places[number + 1], camera_id=1, image_id=number + 1
        )
        made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(motion))
    for index, point in enumerate(points):
        track = pycolmap.Track([pycolmap.TrackElement(number + 1, index) for number in range(len(VIEWS))])
        made.add_point3D(point, track)
    return made, places


def misplaced(made: Any, places: dict[int, np.ndarray], size: float) -> None:
    for number in (1, 3):  # the middle view is what the others are compared with
        for index, place in enumerate(places[number]):
            made.image(number).point2D(index).xy = place + RNG.uniform(-size, size, 2)


def errors(made: Any, places: dict[int, np.ndarray]) -> np.ndarray:
    return np.array([
        np.ravel(made.image(number).point2D(index).xy) - place
        for number in (1, 3)
        for index, place in enumerate(places[number])
        if made.image(number).point2D(index).has_point3D()
    ])  # fmt: skip


def test_places_that_are_half_a_pixel_off_come_back_to_a_few_hundredths() -> None:
    points = np.column_stack([RNG.uniform((-1.5, -1.0), (1.5, 1.0), (60, 2)), np.zeros(60)])
    made, places = model(points)
    misplaced(made, places, 0.5)
    assert np.abs(errors(made, places)).mean() > 0.2
    refine_points(made, {view: picture(number, noise=1.0) for number, view in enumerate(VIEWS)}, unreported)
    after = errors(made, places)
    assert len(after) > 0.9 * 120
    assert np.sqrt((after**2).mean()) < 0.05
    assert np.abs(after.mean(0)).max() < 0.01


def test_a_patch_that_shows_something_else_is_dropped() -> None:
    points = np.column_stack([RNG.uniform((-1.5, -1.0), (1.5, 1.0), (40, 2)), np.zeros(40)])
    made, _ = model(points)
    pictures = {view: picture(number, noise=2.0) for number, view in enumerate(VIEWS)}
    blank = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH)).astype(np.uint8)
    pictures[VIEWS[2]] = cv2.imencode(".png", blank)[1].tobytes()
    refine_points(made, pictures, unreported)
    assert sum(point.has_point3D() for point in made.image(3).points2D) <= 2
    assert sum(point.has_point3D() for point in made.image(1).points2D) >= 36


def test_views_without_texture_leave_nothing_and_raise_nothing() -> None:
    points = np.column_stack([RNG.uniform((-1.5, -1.0), (1.5, 1.0), (20, 2)), np.zeros(20)])
    made, _ = model(points)
    grey = cv2.imencode(".png", np.full((HEIGHT, WIDTH), 128, np.uint8))[1].tobytes()
    refine_points(made, dict.fromkeys(VIEWS, grey), unreported)
    assert made.num_points3D() == 0


def test_views_without_a_picture_stay_as_they_are() -> None:
    points = np.column_stack([RNG.uniform((-1.5, -1.0), (1.5, 1.0), (40, 2)), np.zeros(40)])
    made, places = model(points)
    misplaced(made, places, 0.3)
    before = [np.ravel(point.xy).tolist() for point in made.image(3).points2D]
    refine_points(made, {VIEWS[0]: picture(0, noise=1.0), VIEWS[1]: picture(1, noise=1.0)}, unreported)
    assert [np.ravel(point.xy).tolist() for point in made.image(3).points2D] == before
    refine_points(made, {}, unreported)
    assert all(point.has_point3D() for point in made.image(3).points2D)
