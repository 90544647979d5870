"""Predictions beside shots: a right one is never punished, and what is masked has no part in any figure."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.support import trial
from imaging.files.tiff.dng import write_dng
from imaging.metrics import PSNR_CAP
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.sensor.sensor_calibration import Measured, SensorCalibration
from imaging.session.calibration import Response
from recon.data.dataset import Sensor, View
from recon.data.pixels import ShotSource, read_shot
from recon.data.shot import HeldPlanes, Shot
from recon.measure import view_figures
from recon.observe.linear import LinearLight
from recon.observe.photographs import Display
from recon.observe.shot_comparison import shot_psnr
from recon.splat import SplatCamera
from recon.train.devices.ranks import Ranks
from recon.train.live_curve import held_out_psnr

LINEAR = Response(kind="linear", evidence="test")
WHITE, BLACK, CEILING = 16383, 512, 15300


def view_of(shots, kind, cfa=None):
    height, width = shots[0].pixels.shape[:2]
    lens = SplatCamera(np.eye(4), 50.0, 50.0, width / 2, height / 2, width, height)
    sensor = Sensor(kind, cfa, np.eye(3), np.ones((height, width), np.float32), LINEAR)
    return View("c", 0, lens, sensor, tuple(shots))


def figures(view, observation, image) -> tuple[dict, float]:
    """The row of an evaluation, and the live curve's dB, of a model that draws `image`."""
    method = SimpleNamespace(observation=observation, degree=lambda _: 0)
    drawn = SimpleNamespace(image=torch.from_numpy(image))
    training = SimpleNamespace(
        method=method, gaussians=None, refinement=None, renderer=lambda: lambda *_, degree: drawn
    )
    dataset = SimpleNamespace(reported=(view,), trained_at=lambda k: True)
    row: dict = {}
    view_figures._against_shots(SimpleNamespace(training=training, dataset=dataset), drawn.image, view, row)
    return row, held_out_psnr(method, None, lambda *_, degree: drawn, None, (view,), 1.0, Ranks())


@pytest.mark.parametrize("measured", [True, False])
def test_the_true_light_is_right_where_the_sensor_ends_below_white(tmp_path, measured):
    """A quarter is clipped at 15300 of 16383: no figure tells the truth from what was recorded."""
    light = np.exp(np.random.default_rng(0).normal(0, 0.1, (64, 64, 3))).astype(np.float32) * 0.3
    light[:, :16] *= 8
    codes = np.minimum(BLACK + mosaic(light, Cfa.RGGB) * (WHITE - BLACK), CEILING).round().astype(np.uint16)
    metadata = FrameMetadata(exposure=Exposure(time=1.0, iso=100))
    write_dng(tmp_path / "a.dng", RawMosaic(codes, Cfa.RGGB, ((float(BLACK),),), WHITE, metadata=metadata))
    known = SensorCalibration(iso=100, ceiling=Measured(value=CEILING, sigma=0.3, source="brackets"))
    sensors = (known,) if measured else ()
    source = ShotSource(tmp_path / "a.dng", "a.dng", "raw", LINEAR, sensors=sensors)
    shot, cfa = read_shot(source, 1.0)
    assert shot.top == pytest.approx((CEILING - BLACK) / (WHITE - BLACK) if measured else 1)
    view, observation = view_of([shot], "raw", cfa), LinearLight(1.0)
    row, live = figures(view, observation, light)
    predicted = [observation.predict(torch.from_numpy(light), view, shot.k)]
    bench = trial._signal(predicted, [shot], np.ones((64, 64)))["raw_psnr"]
    assert row["raw_psnr"] == pytest.approx(live, abs=1e-9)
    assert row["raw_psnr"] == pytest.approx(bench, abs=1e-9)
    # Codes are whole numbers: that is all that is left. Without the calibration nobody knows of the ceiling.
    assert (row["raw_psnr"] > 90) == measured
    dimmer = figures(view, observation, 0.5 * light)[0]["raw_psnr"]
    assert dimmer < 30


def test_a_clipped_pixel_of_a_smaller_image_bounds_the_light():
    """It is averaged from clipped and other sites: only a prediction below it is wrong."""
    recorded = np.full((4, 4, 3), 0.5, np.float32)
    saturated, never = np.zeros((2, 4, 4, 3), bool)
    saturated[:2] = True
    shot = Shot("a", 1.0, HeldPlanes(recorded, saturated, never, ~never), ceiling=0.9)
    above, below = (torch.where(torch.from_numpy(saturated), value, 0.5) for value in (3.0, 0.4))
    assert shot_psnr(above, shot) == PSNR_CAP
    assert shot_psnr(below, shot) == pytest.approx(-10 * np.log10(0.1**2 / 2), abs=1e-4)


@pytest.mark.parametrize("kind", ["raw", "ldr", "hdr"])
def test_the_same_error_gives_the_same_figures_whatever_is_masked(kind):
    """Every row of the picture is alike, so what is masked of them is no matter."""
    rng = np.random.default_rng(0)
    truth = (0.5 + 0.3 * np.sin(np.arange(120) / 3)).astype(np.float32)[None, :, None].repeat(3, 2)
    model = np.clip(truth + rng.normal(0, 0.1, truth.shape), 0, 1).astype(np.float32)
    truth, model = np.repeat(truth, 100, 0), np.repeat(model, 100, 0)
    results = []
    for share in (0.0, 0.5, 0.8):
        valid = np.ones(truth.shape, bool)
        valid[: int(share * len(truth))] = False
        never = np.zeros_like(valid)
        # What is behind the mask is nothing like the model.
        pixels = np.where(valid, truth, 1 - truth).astype(np.float32)
        shot = Shot("a", 1.0, HeldPlanes(pixels, never, never, valid), ceiling=1.0 if kind == "raw" else None)
        observation = Display(LINEAR, 1.0) if kind == "ldr" else LinearLight(1.0)
        results.append(figures(view_of([shot], kind), observation, model))
    (row, live), *masked = results
    assert live == pytest.approx({"raw": 20, "ldr": 20, "hdr": 26}[kind], abs=1)
    assert set(row) == {"raw": {"raw_psnr"}, "ldr": {"ldr_psnr_oe", "ssim"}, "hdr": set()}[kind]
    assert row.get("ssim", 0.6) < 0.8
    for masked_row, curve in masked:
        assert masked_row == pytest.approx(row, abs=1e-6)
        assert curve == pytest.approx(live, abs=1e-4)


def test_a_shot_that_is_masked_altogether_has_no_figure():
    truth, never = np.full((16, 16, 3), 0.5, np.float32), np.zeros((16, 16, 3), bool)
    shots = [
        Shot("a", 1.0, HeldPlanes(truth, never, never, ~never)),
        Shot("b", 2.0, HeldPlanes(truth, never, never, never)),
    ]
    row, live = figures(view_of(shots, "ldr"), Display(LINEAR, 1.0), truth + np.float32(0.1))
    assert row["ldr_psnr_oe"] == pytest.approx(20, abs=1e-4)
    assert live == pytest.approx(20, abs=1e-4)
    assert figures(view_of(shots[1:], "ldr"), Display(LINEAR, 1.0), truth)[0] == {}
