"""The simulated camera: the protocol, the radiometric model, and the same bytes for the same shot."""

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from drivers.camera import CameraFile
from drivers.sim.camera import response, shutter
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.colour.spaces import camera_from_rec709, srgb_encode
from imaging.errors import CameraError
from imaging.files.photo import read_photo
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import BAYER, Cfa
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.shots import raw_shot, shot


def ideal(rig: SimulatedRig, index: int, **changes: object) -> SimulatedCamera:
    """A camera of the rig whose sensor has no fixed pattern."""
    body = rig.bodies[index]
    sensor = replace(body.sensor, prnu=0.0, dsnu=0.0, hot_share=0.0, dark_current=0.0)
    return SimulatedCamera(replace(body, sensor=sensor, **changes), lambda frame: rig.radiance(index, frame))


@pytest.mark.parametrize("bits", [12, 14])
@pytest.mark.parametrize("cfa", BAYER)
def test_mean_signal_is_the_radiometric_model(cfa: Cfa, bits: int) -> None:
    rig = simulate("toy", bit_depth=bits, seed=3)
    camera = ideal(rig, 1, cfa=cfa)
    body, lens = camera.body, camera.body.optics.lens
    label = Exposure(time=1 / 60, f_number=5.6, iso=200)
    takes = 64
    camera.place(2)
    frames = np.stack([raw_shot(camera, label).pixels for _ in range(takes)]).astype(float)

    # The contract's formula, written out again: x = V gain (M L) k.
    v, u = np.mgrid[0 : lens.height, 0 : lens.width] + 0.5
    r2 = ((u - lens.width / 2) ** 2 + (v - lens.height / 2) ** 2) / (
        (lens.width / 2) ** 2 + (lens.height / 2) ** 2
    )
    a, b, c = body.optics.vignetting
    matrix = camera_from_rec709(body.camera_from_xyz)
    colour = rig.radiance(1, 2).astype(float) @ matrix.T
    k = 2.0 * 2.0**-6 / 32.0
    x = (1 + a * r2 + b * r2**2 + c * r2**3)[..., None] * body.optics.gain * colour * k
    pattern = ["RGB".index(letter) for letter in "".join(cfa.rows)]
    site = np.empty(r2.shape)
    black = np.empty(r2.shape)
    for place, (row, column) in enumerate(itertools.product((0, 1), (0, 1))):
        site[row::2, column::2] = x[row::2, column::2, pattern[place]]
        black[row::2, column::2] = np.ravel(body.sensor.black)[place]
    span = body.sensor.white - np.mean(body.sensor.black)
    expected = black + site * span
    # Where nothing clips, at either end.
    variance = (2 * body.sensor.gain * body.sensor.read_noise) ** 2 + 1 / 12
    variance = variance + 2 * body.sensor.gain * site * span
    fits = expected + 6 * np.sqrt(variance) < body.sensor.white
    assert fits.mean() > 0.95
    z = ((frames.mean(0) - expected) / np.sqrt(variance / takes))[fits]
    assert abs(z.mean()) < 4 / math.sqrt(z.size)
    assert z.std() == pytest.approx(1.0, abs=0.06)
    assert np.abs(z).max() < 5.5


def test_metadata_tell_what_a_raw_file_tells() -> None:
    rig = simulate("toy")
    for index, camera in enumerate(rig.cameras):
        frame = raw_shot(camera, Exposure(time=0.012))
        body, identity = rig.bodies[index], camera.identify()
        assert frame.metadata.exposure == Exposure(time=1 / 80, f_number=4.0, iso=100.0)
        assert (frame.metadata.serial, frame.metadata.model) == (identity.serial, identity.model)
        assert frame.black == body.sensor.black
        assert frame.white == 4095
        assert frame.neutral is not None
        assert max(frame.neutral) == 1.0
        assert frame.camera_from_xyz is not None
        np.testing.assert_allclose(
            camera_from_rec709(frame.camera_from_xyz), body.optics.camera_from_rec709, rtol=1e-9
        )
        assert frame.noise_profile is not None
        assert frame.noise_profile[0] * 3839 == pytest.approx(body.sensor.gain, rel=0.02)


def test_dials_show_labels_and_apply_powers_of_two() -> None:
    assert len(shutter.APPLIED_TIME) == 55
    for label, time in shutter.APPLIED_TIME.items():
        assert abs(math.log2(label / time)) < 0.11
    assert shutter.APPLIED_TIME[1 / 60] == 1 / 64
    assert shutter.APPLIED_TIME[30.0] == 32.0
    assert shutter.APPLIED_TIME[1 / 8000] == 2.0**-13
    camera = simulate("toy").cameras[0]
    assert camera.set_exposure(Exposure(time=1 / 59, f_number=4.1, iso=130)) == Exposure(
        time=1 / 60, f_number=4.0, iso=100
    )
    assert camera.set_exposure(Exposure(time=1e-9)).time == 1 / 8000
    assert camera.set_exposure(Exposure(time=1e9, f_number=100, iso=1e6)) == Exposure(
        time=30.0, f_number=16.0, iso=1600.0
    )
    times = camera.capabilities().times
    assert list(times) == sorted(times)


def test_calls_out_of_order_are_refused() -> None:
    camera = simulate("toy").cameras[0]
    for call in (camera.trigger, camera.collect):
        with pytest.raises(CameraError, match="set_exposure, arm, trigger and collect"):
            call()
    camera.arm()
    with pytest.raises(CameraError):
        camera.arm()
    camera.set_exposure(Exposure(time=1 / 60))  # setting disarms
    with pytest.raises(CameraError):
        camera.trigger()
    camera.arm()
    camera.trigger()
    with pytest.raises(CameraError):
        camera.set_exposure(Exposure(time=1 / 60))
    camera.collect()
    with pytest.raises(CameraError):
        camera.collect()
    camera.close()
    camera.close()
    with pytest.raises(CameraError, match="closed"):
        camera.set_exposure(Exposure(time=1 / 60))


def all_shots(rig: SimulatedRig, order: list[tuple[int, int, int]]) -> dict[tuple[int, int, int], object]:
    shots = {}
    for frame, step, index in order:
        rig.move_to(frame)
        camera = rig.cameras[index]
        camera.set_exposure(rig.bracket[step])
        camera.arm()
        opened = camera.trigger()
        got = camera.collect()
        data = got.pixels.tobytes() if isinstance(got, RawMosaic) else got.data
        shots[frame, step, index] = (opened, data, got.metadata)
    return shots


@pytest.mark.parametrize("effects", [False, True])
@pytest.mark.parametrize("name", ["toy", "toy-ldr"])
def test_a_shot_does_not_depend_on_what_was_shot_before(name: str, effects: bool) -> None:
    rig = simulate(name, 5, effects=effects)
    order = list(itertools.product(range(3), range(len(rig.bracket)), range(2)))
    first = all_shots(rig, order)
    again = simulate(name, 5, effects=effects)
    np.random.default_rng(1).shuffle(order)
    assert all_shots(again, [tuple(entry) for entry in order]) == first
    assert len({data for _, data, _ in first.values()}) == len(first)
    other = all_shots(simulate(name, 6, effects=effects), [(0, 0, 0)])
    assert other[0, 0, 0] != first[0, 0, 0]


def test_equal_exposures_of_one_frame_have_their_own_noise() -> None:
    rig = simulate("toy")
    exposure = rig.bracket[2]
    rig.move_to(1)
    first, second = (raw_shot(rig.cameras[0], exposure).pixels for _ in range(2))
    assert not np.array_equal(first, second)
    rig.move_to(1)
    np.testing.assert_array_equal(raw_shot(rig.cameras[0], exposure).pixels, first)
    rig.move_to(1, step=1)
    assert not np.array_equal(raw_shot(rig.cameras[0], exposure).pixels, first)


def test_trigger_times_come_from_the_clock_if_there_is_one() -> None:
    ticks = itertools.count(10)
    camera = simulate("toy", clock=lambda: float(next(ticks))).cameras[0]
    camera.arm()
    assert camera.trigger() == 10.0
    camera.collect()
    camera.arm()
    assert camera.trigger() == 11.0


def test_without_a_clock_the_cameras_open_within_a_millisecond() -> None:
    rig = simulate("toy")
    rig.move_to(2)
    for camera in rig.cameras:
        camera.set_exposure(rig.bracket[0])
        camera.arm()
    first, second = (camera.trigger() for camera in rig.cameras)
    assert 0 < abs(first - second) < 1e-3


def test_effects_jitter_the_shutter_and_stripe_the_rows() -> None:
    plain, rough = simulate("toy", 2), simulate("toy", 2, effects=True)
    short, long = Exposure(time=1 / 1000), Exposure(time=1 / 4)
    ratios = []
    for frame in range(3):
        for exposure in (short, long):
            pair = []
            for rig in (plain, rough):
                rig.move_to(frame)
                pair.append(raw_shot(rig.cameras[0], exposure).signal())
            lit = (pair[0] > 0.05) & (pair[0] < 0.9)
            ratios.append(float(np.median(pair[1][lit] / pair[0][lit])))
    assert np.std(ratios) > 0.003
    assert np.all(np.abs(np.log(ratios)) < 0.08)
    stripes = simulate("toy", light=0.0, effects=True, width=128, height=96)
    rows = raw_shot(stripes.cameras[0], short).signal().mean(axis=1)
    quiet = raw_shot(simulate("toy", light=0.0, width=128, height=96).cameras[0], short).signal().mean(axis=1)
    assert rows.std() > 1.3 * quiet.std()


def test_the_response_is_an_s_curve_with_an_inverse() -> None:
    x = np.geomspace(1e-4, 1.0, 400)
    code = response.develop(x)
    assert np.all(np.diff(code) > 0)
    np.testing.assert_allclose(response.exposure_of(code), x, rtol=1e-9)
    assert (response.develop(np.array(0.0)), response.develop(np.array(1.0))) == (0.0, 1.0)
    assert response.develop(np.array(7.0)) == 1.0
    slope = np.gradient(code, np.log(x))
    top = int(slope.argmax())
    assert 0 < top < 399, "steepest in the middle"
    assert slope[0] < 0.01
    assert slope[-1] < 0.75 * slope[top]
    for gamma in (1 / 2.2, 1 / 2.4, 1.0):
        assert np.abs(code - x**gamma).max() > 0.05


def test_other_responses_are_the_standard_and_a_power() -> None:
    x = np.geomspace(1e-4, 1.0, 400)
    for curve in get_args(response.Curve):
        code = response.develop(x, curve)
        assert np.all(np.diff(code) > 0)
        np.testing.assert_allclose(response.exposure_of(code, curve), x, rtol=1e-9)
    np.testing.assert_allclose(response.develop(x, "srgb"), srgb_encode(x), atol=1e-12)
    np.testing.assert_allclose(response.develop(np.array(0.25), "gamma") ** 1.8, 0.25)


def test_photographs_follow_the_response(tmp_path: Path) -> None:
    rig = simulate("toy-ldr", 1)
    rig.move_to(1)
    radiance = rig.radiance(0, 1).astype(float)
    optics, compared = rig.bodies[0].optics, 0
    for exposure in rig.bracket:
        photo = shot(rig.cameras[0], exposure)
        assert isinstance(photo, CameraFile)
        assert photo.suffix == ".jpg"
        path = tmp_path / "photo.jpg"
        path.write_bytes(photo.data)
        read = read_photo(path)
        assert read.metadata.exposure is not None
        assert read.metadata.exposure.time == pytest.approx(exposure.time, rel=1e-3)
        assert read.metadata.serial == rig.bodies[0].serial
        x = radiance * optics.gain * optics.falloff()[..., None] * shutter.applied(exposure).scale
        expected = response.develop(x)
        error = read.pixels - expected
        assert np.median(np.abs(error)) < 4 / 255
        for low in np.arange(0.02, 0.98, 0.08):
            inside = (expected > low) & (expected < low + 0.08)
            if inside.sum() > 100:
                assert abs(np.median(error[inside])) < 1.5 / 255
                compared += 1
    assert compared > 20
