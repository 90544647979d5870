"""Range, texture, geometry and exposure of the demo's 24 simulated views."""

import math

import cv2
import numpy as np
import pytest

from drivers.sim.camera.lens import unproject
from drivers.sim.mounting import ARC_STEP
from drivers.sim.rigs import SimulatedRig, names, simulate
from imaging.errors import InputError
from imaging.sensor.cfa import bilinear
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import raw_shot

LUMINANCE = np.array((0.2126, 0.7152, 0.0722))


@pytest.fixture(scope="module")
def demo() -> SimulatedRig:
    return simulate("demo", samples=2)


def shoot(rig: SimulatedRig, camera: int, frame: int) -> list[RawMosaic]:
    """The bracket of one camera at one frame."""
    rig.move_to(frame)
    return [raw_shot(rig.cameras[camera], exposure) for exposure in rig.bracket]


def preview(shots: list[RawMosaic]) -> np.ndarray:
    """A bracket as an 8-bit log image, by the simplest merge there is."""
    total = np.zeros(shots[0].pixels.shape)
    scale = np.full(total.shape, 1e-12)
    for shot in shots:
        assert shot.metadata.exposure is not None
        total += np.where(shot.saturated(), 0, shot.signal())
        scale += np.where(shot.saturated(), 0, shot.metadata.exposure.scale)
    rgb, _ = bilinear(total / scale, shots[0].cfa)
    grey = rgb.mean(axis=2)
    log = np.log2(np.maximum(grey, 0) + np.median(grey) / 64)
    low, high = np.percentile(log, (0.5, 99.5))
    return (255 * np.clip((log - low) / (high - low), 0, 1)).astype(np.uint8)


def test_the_scene_spans_more_than_fourteen_stops(demo: SimulatedRig) -> None:
    views = np.stack([demo.radiance(c, f) for f in range(6) for c in range(4)])
    assert views.min() > 0
    low, high = np.percentile(views @ LUMINANCE, (0.1, 99.99))
    assert 16.0 < math.log2(high / low) < 18.5


def test_every_view_has_texture_for_sift(demo: SimulatedRig) -> None:
    sift = cv2.SIFT_create(contrastThreshold=0.005)
    for frame in range(demo.frames):
        for camera in range(4):
            image = preview(shoot(demo, camera, frame))
            assert len(sift.detect(image, None)) >= 800, f"camera {camera}, frame {frame}"


def test_the_bracket_holds_the_lamp_and_the_shadows(demo: SimulatedRig) -> None:
    for camera, frame in ((0, 0), (1, 2), (2, 3), (3, 5)):
        shots = shoot(demo, camera, frame)
        assert shots[0].saturated().mean() <= 0.001
        assert shots[0].signal().max() > 0.4, "the lamp is in view and uses the range"
        # Mean signal in electrons where the scene is darkest, against the noise there.
        truth = demo.radiance(camera, frame) @ LUMINANCE
        dark = truth <= np.percentile(truth, 1.0)
        electrons = shots[-1].signal()[dark] * demo.bodies[camera].sensor.white_electrons
        assert electrons.mean() / math.sqrt(electrons.mean() + 9) > 1.5


def test_neighbouring_frames_are_at_most_thirty_degrees_apart(demo: SimulatedRig) -> None:
    for camera in range(4):
        axes = np.array([demo.cam_from_world(camera, frame)[2, :3] for frame in range(demo.frames)])
        steps = np.degrees(np.arccos(np.sum(axes[1:] * axes[:-1], axis=1)))
        assert np.all(np.abs(steps - ARC_STEP) < 3)


def test_the_rig_is_rigid(demo: SimulatedRig) -> None:
    for camera in range(4):
        mounted = [
            demo.cam_from_world(camera, f) @ np.linalg.inv(demo.cam_from_world(0, f))
            for f in range(demo.frames)
        ]
        for pose in mounted:
            np.testing.assert_allclose(pose, demo.mounts[camera].cam_from_rig, atol=1e-12)
            np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)


def test_cameras_differ_as_cameras_do(demo: SimulatedRig) -> None:
    matrices = np.stack([body.optics.camera_from_rec709 for body in demo.bodies])
    assert np.all(matrices > 0)
    np.testing.assert_allclose(matrices[:, 1].sum(axis=1), 1.0, rtol=1e-12)
    assert np.ptp(matrices[:, 0].sum(axis=1)) > 0.01
    for body in demo.bodies:
        corner = 1.0 + sum(body.optics.vignetting)
        assert 0.68 < corner < 0.82
        assert abs(body.optics.gain - 1) <= 0.02
        assert -0.08 <= body.optics.lens.k1 <= -0.05


def test_names_and_overrides() -> None:
    listed = "demo, demo-ldr, gallery, gallery-ldr, demo-fisheye, nodal, turntable, dome, toy, toy-ldr, "
    listed += "toy-fisheye, toy-x-trans, toy-quad-bayer, toy-rgbw, toy-mono, toy-wheel"
    assert ", ".join(names()) == listed
    with pytest.raises(InputError, match=listed):
        simulate("demos")
    with pytest.raises(InputError, match="positions"):
        simulate("toy", colour=3)
    rig = simulate("toy", width=32, height=24, positions=2, bit_depth=14)
    assert rig.frames == 2
    assert rig.cameras[0].capabilities().width == 32
    assert shoot(rig, 0, 1)[0].white == 16383
    with pytest.raises(InputError, match="0 to 1"):
        rig.move_to(2)


def test_darkness_and_glare() -> None:
    dark = simulate("toy", light=0.0)
    for shot in shoot(dark, 0, 0):
        assert abs(float(shot.signal().mean())) < 1e-4
    for shot in shoot(simulate("toy", light=1e6), 0, 0):
        assert shot.saturated().all()


def test_a_rig_of_fisheyes_sees_120_degrees_and_is_else_the_same() -> None:
    """Built of the same parts and at the same places; only what reaches the sensor differs."""
    usual, wide = simulate("toy", seed=3), simulate("toy", seed=3, lens="fisheye")
    for before, after in zip(usual.mounts, wide.mounts, strict=True):
        lens = after.optics.lens
        assert lens.model == "OPENCV_FISHEYE"
        corners = unproject(lens, [[0.0, 0.0], [lens.width, lens.height]])
        assert 110 < np.degrees(np.arccos(corners[0] @ corners[1])) < 130
        assert (lens.cx, lens.cy) == (before.optics.lens.cx, before.optics.lens.cy)
        np.testing.assert_array_equal(before.cam_from_rig, after.cam_from_rig)
        assert before.optics.vignetting == after.optics.vignetting
    assert len({mount.optics.lens.k1 for mount in wide.mounts}) == 2


def test_ideal_cameras_lack_distortion_falloff_and_differences() -> None:
    optics = [mount.optics for mount in simulate("toy", 3, distortion=0, vignetting=0, gains=0).mounts]
    assert all(one.lens.terms[4:] == (0, 0, 0, 0) for one in optics)
    assert all((one.falloff() == 1).all() and one.gain == 1 for one in optics)
    assert simulate("toy-fisheye", 3, distortion=0).mounts[0].optics.lens.k1 > 0.01
    as_built, half = (simulate("toy", 3, **how).mounts[1].optics for how in ({}, {"vignetting": 0.5}))
    np.testing.assert_allclose(1 - half.falloff(), 0.5 * (1 - as_built.falloff()), atol=1e-12)
    assert (half.lens, half.gain) == (as_built.lens, as_built.gain)
    assert simulate("toy", 3, gains=3).mounts[1].optics.gain - 1 == pytest.approx(3 * (as_built.gain - 1))


def test_soft_light_fits_into_one_exposure_and_dull_things_look_alike_from_everywhere() -> None:
    soft = simulate("toy", even=True, gloss=0.0, vignetting=0)
    rig = simulate("toy", even=True)
    pictures = [soft.radiance(camera, frame) for camera in range(2) for frame in range(3)]
    assert np.percentile(pictures, 99.99) / np.percentile(pictures, 0.1) < 2**6
    middle = shoot(soft, 0, 1)[1].signal()
    assert (middle.max() < 1.0, np.median(middle) > 0.05) == (True, True)
    # Without lamps there is no highlight to see on anything, dull or not.
    np.testing.assert_array_equal(rig.radiance(0, 1), soft.radiance(0, 1))
    lit = {gloss: simulate("toy", gloss=gloss).scene for gloss in (0.0, 0.2)}
    eyes = np.array([[-1.2, -1.4, 1.4], [-0.4, -1.9, 1.5]])
    place = np.array([0.45, -0.42, 0.50])  # bare wood near the edge of the table
    dull, shiny = (lit[gloss].radiance(eyes, place - eyes) for gloss in (0.0, 0.2))
    np.testing.assert_allclose(dull[0], dull[1], rtol=1e-9)
    assert np.abs(np.log(shiny[0] / shiny[1])).max() > 0.02
