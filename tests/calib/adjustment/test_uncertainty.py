"""The standard errors that are stated of poses, against models whose truth is known."""

import re
from typing import Any

import cv2
import numpy as np
import pytest

from calib.adjustment import reduced_curvature, uncertainty
from calib.adjustment.bundle_adjustment import Free, adjust, opencv_parameters, set_model
from calib.adjustment.jacobian import TERMS, linearise
from imaging.files.colmap import pycolmap
from imaging.optics.lens import LensModel
from imaging.progress import unreported
from imaging.session.view_id import ViewId

NOISE = 0.3
RADIAL = Free("RADIAL", principal_point=True)


def made(seed: int, points: int = 200, spare: int = 0) -> Any:
    """Two cameras on a rig at six places, each point seen by four of the twelve views."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 2, 6
    options.num_points3D, options.num_points2D_without_point3D, options.track_length = points, spare, 4
    options.camera_width, options.camera_height = 640, 480
    options.camera_params = [640.0, 320.0, 240.0, -0.05]
    pycolmap.set_random_seed(seed)
    model = pycolmap.synthesize_dataset(options)
    for image in model.images.values():
        camera, frame = re.findall(r"0*(\d+)", image.name)[:2]
        image.name = ViewId(int(frame), f"cam{camera}").image_name
    return model


def noisy(model: Any, seed: int) -> Any:
    rng = np.random.default_rng(seed)
    copy = pycolmap.Reconstruction(model)
    for index in sorted(copy.reg_image_ids()):
        for point in copy.image(index).points2D:
            point.xy = np.ravel(point.xy) + rng.normal(0, NOISE, 2)
    return copy


def residuals(model: Any) -> np.ndarray:
    """[N, 2] in the order of `Linear`."""
    misses = []
    for index in sorted(model.reg_image_ids()):
        image = model.image(index)
        motion = image.cam_from_world().matrix()
        for point in image.points2D:
            if point.has_point3D():
                local = motion[:, :3] @ model.points3D[point.point3D_id].xyz + motion[:, 3]
                misses.append(
                    model.cameras[image.camera_id].img_from_cam(local[None])[0] - np.ravel(point.xy)
                )
    return np.array(misses)


@pytest.mark.parametrize(
    ("lens", "terms"), [("OPENCV", [-0.05, 0.02, 1e-3, -2e-3]), ("OPENCV_FISHEYE", [0.05, -0.3, 0.4, -0.6])]
)
def test_derivatives_are_those_of_finite_differences(lens: LensModel, terms: list[float]) -> None:
    model = noisy(made(0, 30), 0)
    for camera in model.cameras.values():
        set_model(camera, lens)
        camera.params = [630.0, 650.0, 318.0, 243.0, *terms]
    linear = linearise(model, Free(lens))
    np.testing.assert_allclose(linear.residual, residuals(model), atol=1e-9)
    step, jacobian = 1e-6, linear.cameras.toarray()

    def moved(motion: Any, term: int, amount: float) -> Any:
        change = np.eye(4)
        if term < 3:
            change[:3, :3] = cv2.Rodrigues(amount * np.eye(3)[term])[0]
        else:
            change[term - 3, 3] = amount
        return pycolmap.Rigid3d((change @ np.vstack([motion.matrix(), [0, 0, 0, 1]]))[:3])

    def slope(change: Any) -> np.ndarray:
        sides = []
        for amount in (step, -step):
            copy = pycolmap.Reconstruction(model)
            change(copy, amount)
            sides.append(residuals(copy))
        return np.asarray(sides[0] - sides[1]).ravel() / (2 * step)

    frame, at = sorted(linear.frames.items())[1]
    for term in range(6):

        def rig(copy: Any, amount: float, term: int = term) -> None:
            copy.frames[frame].rig_from_world = moved(copy.frames[frame].rig_from_world, term, amount)

        np.testing.assert_allclose(jacobian[:, at + term], slope(rig), atol=1e-4)
    number, at = next(iter(linear.sensors.items()))
    for term in range(6):

        def sensor(copy: Any, amount: float, term: int = term) -> None:
            rig = next(iter(copy.rigs.values()))
            one = pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number)
            rig.set_sensor_from_rig(one, moved(rig.sensor_from_rig(one), term, amount))

        np.testing.assert_allclose(jacobian[:, at + term], slope(sensor), atol=1e-4)
    number, at = sorted(linear.lenses.items())[1]
    for term in range(TERMS):

        def optics(copy: Any, amount: float, term: int = term) -> None:
            values = opencv_parameters(copy.cameras[number])
            values[term] += amount
            copy.cameras[number].params = values

        np.testing.assert_allclose(jacobian[:, at + term], slope(optics), atol=1e-4)
    numbers = sorted(model.points3D)
    for axis in range(3):

        def point(copy: Any, amount: float, axis: int = axis) -> None:
            copy.points3D[numbers[2]].xyz = copy.points3D[numbers[2]].xyz + amount * np.eye(3)[axis]

        of_point = np.where((linear.owner == 2)[:, None], linear.points[:, :, axis], 0.0)
        np.testing.assert_allclose(of_point.ravel(), slope(point), atol=1e-4)


def ratios(seed: int) -> np.ndarray:
    """Errors of all views in stated standard errors, [views, 2]: rotation and place."""
    truth = made(seed)
    model = noisy(truth, seed)
    for _ in range(3):
        adjust(model, RADIAL, NOISE, 1)
    stated = uncertainty.standard_errors(model, RADIAL, NOISE, unreported)
    assert stated is not None
    true = uncertainty._poses(truth)
    drawn = []
    for key, pose in uncertainty._aligned(uncertainty._poses(model), true).items():
        turn = uncertainty._turned((pose @ np.linalg.inv(true[key]))[:3, :3])
        shift = uncertainty.centre_of(pose) - uncertainty.centre_of(true[key])
        drawn.append(
            (
                np.degrees(np.linalg.norm(turn)) / stated.rotation[key],
                np.linalg.norm(shift) / stated.translation[key],
            )
        )
    return np.array(drawn)


def test_true_poses_lie_within_what_is_stated() -> None:
    """Along one axis the mean square is 1, along three that are alike 3; 95 % lie within 2.8."""
    every = np.stack([ratios(seed) for seed in range(12)])
    assert np.all((every < 2.8).mean((0, 1)) > 0.9)
    mean_square = (every**2).mean((0, 1))
    assert np.all(mean_square > 0.8)
    assert np.all(mean_square < 3.2)


@pytest.fixture(scope="module")
def model() -> Any:
    adjusted = noisy(made(3), 3)
    adjust(adjusted, RADIAL, NOISE, 1)
    return adjusted


def test_the_same_points_twice_are_no_surer() -> None:
    single = noisy(made(3, spare=200), 3)
    adjust(single, RADIAL, NOISE, 1)
    once = uncertainty.standard_errors(single, RADIAL, NOISE, unreported)
    double = pycolmap.Reconstruction(single)
    spare = {
        number: [place for place, point in enumerate(image.points2D) if not point.has_point3D()]
        for number, image in double.images.items()
    }
    for number in sorted(single.points3D):
        track = pycolmap.Track()
        for element in single.points3D[number].track.elements:
            image, place = double.images[element.image_id], spare[element.image_id].pop()
            image.point2D(place).xy = np.ravel(image.point2D(element.point2D_idx).xy)
            track.add_element(element.image_id, place)
        double.add_point3D(single.points3D[number].xyz, track)
    twice = uncertainty.standard_errors(double, RADIAL, NOISE, unreported)
    assert once is not None
    assert twice is not None
    for key, error in once.rotation.items():
        assert twice.rotation[key] == pytest.approx(error, rel=0.25)


def test_what_is_fixed_has_no_error_and_what_is_free_has(model: Any) -> None:
    fixed = uncertainty.standard_errors(model, Free("RADIAL", fixed=frozenset({1})), NOISE, unreported)
    assert fixed is not None
    assert set(fixed.lenses["cam1"].values()) == {0.0}
    assert all(value > 0 for value in fixed.lenses["cam2"].values())
    assert all(value > 0 for value in fixed.rotation.values())


def test_a_frame_that_few_points_hold_has_no_error(model: Any) -> None:
    """Two points fit a pose whatever it is: what they miss by says nothing of it."""
    few = pycolmap.Reconstruction(model)
    lost = min(few.reg_frame_ids())
    images = [image for image in few.images.values() if image.frame_id == lost]
    for image in images:
        for place, point in enumerate(image.points2D):
            if (
                point.has_point3D()
                and sum(one.num_points3D for one in images) >= uncertainty.FEWEST_OBSERVATIONS
            ):
                few.delete_observation(image.image_id, place)
    stated = uncertainty.standard_errors(few, RADIAL, NOISE, unreported)
    assert stated is not None
    unknown = {ViewId.of_image(image.name) for image in images}
    every = {ViewId.of_image(few.image(number).name) for number in few.reg_image_ids()}
    assert set(stated.rotation) == set(stated.translation) == every - unknown


def test_a_term_that_no_view_tells_is_as_lenses_are_built(model: Any) -> None:
    """One point in the middle of all pictures says nothing about the middle's place."""
    few = pycolmap.Reconstruction(model)
    for number in sorted(few.points3D)[uncertainty.FEWEST_POINTS :]:
        few.delete_point3D(number)
    stated = uncertainty.standard_errors(few, Free(), NOISE, unreported)
    assert stated is not None
    for terms in stated.lenses.values():
        assert terms["cx"] < 1.5 * reduced_curvature.BUILT["cx"] * 640
        assert terms["p1"] < 1.5 * reduced_curvature.BUILT["p1"]
    few.delete_point3D(min(few.points3D))
    assert uncertainty.standard_errors(few, Free(), NOISE, unreported) is None


def test_the_choice_of_the_lens_counts_as_an_error() -> None:
    """The chosen model leaves a middle that is 5 px aside where it was, by residuals of 0.02 px."""
    model = made(3)
    for image in model.images.values():
        for point in image.points2D:
            point.xy = np.ravel(point.xy) + np.array([5.0, 0.0])
    chosen = Free("SIMPLE_RADIAL")
    for _ in range(3):
        adjust(model, chosen, NOISE / 10, 1)
    stated = uncertainty.standard_errors(model, chosen, NOISE / 10, unreported)
    assert stated is not None
    for terms in stated.lenses.values():
        assert terms["cx"] == pytest.approx(5.0, rel=0.5)
        assert terms["cy"] < 1.0


def test_a_term_that_weak_evidence_took_counts_as_an_error() -> None:
    """The lens without it, and the poses along with that, are as far off as the model moved by it."""
    model = made(3)
    for image in model.images.values():
        for point in image.points2D:
            point.xy = np.ravel(point.xy) + np.array([5.0, 0.0])
    chosen = Free("SIMPLE_RADIAL", principal_point=True)
    for _ in range(3):
        adjust(model, chosen, NOISE / 10, 1)
    sure, weak = (
        uncertainty.standard_errors(model, chosen, NOISE / 10, unreported, terms)
        for terms in ((), ("cx", "cy"))
    )
    assert sure is not None
    assert weak is not None
    for name, terms in weak.lenses.items():
        assert terms["cx"] == pytest.approx(5.0, rel=0.2)
        assert sure.lenses[name]["cx"] < 1.0
    turned = np.degrees(5.0 / 600)
    for view, error in weak.rotation.items():
        assert sure.rotation[view] < 0.5 * error < turned
