"""Pixel shift against the light that the simulator rendered, and against the mosaic of one exposure."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.demosaicking.demosaic import demosaic
from imaging.errors import InputError
from imaging.files.raw import read_raw
from imaging.files.tiff.dng import write_dng
from imaging.merge.linear_frame import LinearFrame, from_raw
from imaging.merge.pixel_shift import Shift, combined, shifts
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import BAYER, Cfa
from imaging.sensor.mosaic import RawMosaic
from tests.drivers.pixel_shift import displaced
from tests.drivers.shots import raw_shot

ORDERS: tuple[tuple[Shift, ...], ...] = (
    ((0, 0), (0, 1), (1, 1), (1, 0)),
    ((0, 0), (-1, 0), (-1, -1), (0, -1)),
    ((0, 0), (1, -1), (0, -1), (1, 0)),
)


@pytest.fixture(scope="module")
def toy() -> SimulatedRig:
    return simulate("toy", cameras=1, positions=1, width=160, height=120, samples=2)


def shot(rig: SimulatedRig, order: Sequence[Shift], cfa: Cfa = Cfa.RGGB) -> list[RawMosaic]:
    """Frame of a camera whose sensor moves by these rows and columns."""
    view, frames = rig.radiance(0, 0), []
    for step, (row, column) in enumerate(order):
        body = replace(rig.bodies[0], cfa=cfa)
        camera = SimulatedCamera(body, lambda frame, by=(-row, -column): np.roll(view, by, (0, 1)))
        camera.place(0, step)
        frames.append(raw_shot(camera, Exposure(time=1 / 60, f_number=4.0, iso=100.0)))
    return frames


def errors(rig: SimulatedRig, light: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Departures from the true light in camera RGB, in units of the signal, where usable; [pixels, 3]."""
    truth = rig.bodies[0].optics.exposure(rig.radiance(0, 0))
    inner = (slice(4, -4), slice(4, -4))
    usable = usable[inner].all(2)
    scale = np.median((light[inner] / truth[inner])[usable])
    return (light[inner] / scale - truth[inner])[usable]


@pytest.mark.parametrize("cfa", BAYER)
@pytest.mark.parametrize("order", ORDERS)
def test_where_the_sensor_moved_follows_from_the_pictures(
    toy: SimulatedRig, order: Sequence[Shift], cfa: Cfa
) -> None:
    frames = shot(toy, order, cfa)
    assert shifts([frame.signal() for frame in frames], cfa) == list(order)


def test_light_that_was_not_demosaicked_is_nearer_to_the_truth_and_its_sigma_holds(
    toy: SimulatedRig, tmp_path: Path
) -> None:
    frames = shot(toy, ORDERS[0])
    light, moved = combined(frames)
    assert moved == 0.0
    write_dng(tmp_path / "light.dng", light)
    raw = read_raw(tmp_path / "light.dng")
    np.testing.assert_array_equal(raw.pixels, light.pixels)
    assert (raw.cfa, raw.white, raw.metadata.exposure) == (None, frames[0].white, frames[0].metadata.exposure)
    frame: LinearFrame = from_raw(raw, 1.0)
    assert frame.noise is not None
    together = errors(toy, frame.signal, ~frame.saturated)
    single = demosaic(frames[0].signal(), Cfa.RGGB)
    alone = errors(toy, single.rgb, ~frame.saturated)
    gain = 10 * np.log10(np.mean(alone**2) / np.mean(together**2))
    assert gain > 8.0
    truth = toy.bodies[0].optics.exposure(toy.radiance(0, 0))
    scale = np.median((frame.signal / truth)[~frame.saturated])
    sigma = np.sqrt(frame.noise.variance(truth * scale)) / scale
    whole = (frame.signal / scale - truth) / sigma
    inner = ~frame.saturated & (np.indices(frame.signal.shape)[:2].min(0) > 3)
    inner[-4:], inner[:, -4:] = False, False
    chi_square = [np.mean(whole[..., channel][inner[..., channel]] ** 2) for channel in range(3)]
    np.testing.assert_allclose(chi_square, 1.0, atol=0.1)


def test_a_saturated_sample_saturates_its_colour_there(toy: SimulatedRig) -> None:
    frames = shot(toy, ORDERS[0])
    pixels = frames[1].pixels.copy()
    pixels[40, 61] = frames[1].white  # a green photosite, which saw what lies a column further on
    frames[1] = replace(frames[1], pixels=pixels)
    light, before = combined(frames).light, combined(shot(toy, ORDERS[0])).light
    assert light.saturated()[40, 62].tolist() == [False, True, False]
    assert light.saturated().sum() == before.saturated().sum() + 1


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("when", [1, 2, 3])
def test_where_something_moved_the_first_frame_alone_tells(
    toy: SimulatedRig, when: int, stated: bool
) -> None:
    """Something two thirds brighter comes into the later frames; of the noise the files tell, or nothing."""
    still = [frame if stated else replace(frame, noise_profile=None) for frame in shot(toy, ORDERS[0])]
    frames = list(still)
    for number in range(when, 4):
        pixels, black = frames[number].pixels.copy(), int(frames[number].black[0][0])
        there = pixels[50:66, 70:86]
        there[...] = np.minimum(black + (there.astype(np.float64) - black) * 5 / 3, 4094)
        frames[number] = replace(frames[number], pixels=pixels)
    light, moved = combined(frames)
    assert 16 * 16 < moved * 160 * 120 < 26 * 26
    assert not still[0].saturated()[46:70, 66:90].any()
    level = float(np.mean(light.black))
    alone = (light.white - level) * demosaic(still[0].signal(), Cfa.RGGB).rgb
    np.testing.assert_allclose(light.pixels[51:65, 71:85] - level, alone[51:65, 71:85], atol=1.0)
    beside = np.ones((120, 160), bool)
    beside[40:76, 60:96] = False
    np.testing.assert_array_equal(light.pixels[beside], combined(still).light.pixels[beside])


def test_a_scene_that_moves_as_a_whole_is_refused(toy: SimulatedRig) -> None:
    frames = shot(toy, ((0, 0), (0, 1), (1, 1), (1, 0)))
    late = shot(toy, ((0, 0), (0, 1), (1, 5), (1, 4)))
    with pytest.raises(InputError, match="between them"):
        combined([*frames[:2], *late[2:]])
    brighter = [replace(frame, pixels=(frame.pixels * 0.8).astype(np.uint16)) for frame in frames[2:]]
    with pytest.raises(InputError, match=r"moved between them in \d+% of the picture: shoot from a tripod"):
        combined([*frames[:2], *brighter])


@pytest.mark.parametrize("time", [1 / 250, 1 / 60, 1 / 15])
def test_groups_by_half_photosites_are_refused_with_what_to_do(toy: SimulatedRig, time: float) -> None:
    """Use groups of 8 and 16 exposures."""
    frames = []
    for step, by in enumerate(((0.0, 0.0), (0.0, 0.5), (0.5, 0.5), (0.5, 0.0))):
        camera = SimulatedCamera(toy.bodies[0], partial(displaced, toy, 0, by))
        camera.place(0, step)
        frames.append(raw_shot(camera, Exposure(time=time, f_number=4.0, iso=100.0)))
    with pytest.raises(InputError, match=r"groups of 4 \(those of 8 and 16, by half photosites, are not"):
        combined(frames)


def test_what_is_no_pixel_shift_is_refused(toy: SimulatedRig) -> None:
    still = shot(toy, [(0, 0)] * 4)
    with pytest.raises(InputError, match="did not move by one photosite"):
        combined(still)
    with pytest.raises(InputError, match="3 files are not a complete pixel-shift group"):
        combined(still[:3])
    with pytest.raises(InputError, match="needs Bayer mosaics"):
        combined([replace(still[0], cfa=Cfa.X_TRANS)] * 4)
    with pytest.raises(InputError, match="differ in size"):
        combined([*still[:3], replace(still[3], white=4000)])
