"""Pixels behind a mask move no estimate: rubbish there, another in every shot, against the truth."""

import json
from pathlib import Path

import cv2
import numpy as np

from calib.data.views import scene_views
from calib.light import exposure_scales, radiometry
from calib.light.curves.codes import patches, sample
from calib.sensor import brackets
from calib.view_images import summarise
from drivers.sim.camera.sensor import SimulatedSensor
from imaging.colour.spaces import srgb_encode
from imaging.files import store
from imaging.merge.linear_frame import decode
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.session.session import Session
from tests.calib.light.curves.test_response import smooth
from tests.calib.sensor.conftest import MODEL

from .conftest import make_session

TIMES = (1.0, 0.25, 0.0625)
TRUE = np.array([1.0, 0.25 * 1.08, 0.0625 * 0.95])
"""True times of the shutter where it was set to TIMES."""
HIDDEN = np.s_[16:112, 32:128]
"""Masked rows of 120x160: half of the picture."""


def hide(folder: Path) -> Path:
    """A session, every shot of which gets a mask of HIDDEN."""
    lines = [json.loads(line) for line in (folder / "shots.jsonl").read_text().splitlines()]
    mask = np.full((120, 160), 255, np.uint8)
    mask[HIDDEN] = 0
    store.write_bytes(folder / "masks" / "m.png", cv2.imencode(".png", mask)[1].tobytes())
    lines_with_masks = "".join(json.dumps(line | {"mask": "masks/m.png"}) + "\n" for line in lines)
    (folder / "shots.jsonl").write_text(lines_with_masks)
    return folder


def raw_views(*, rubbish: bool) -> list[list[tuple[RawMosaic, Exposure]]]:
    """Two views in three exposures each; 20,000 electrons at white."""
    rng, views = np.random.default_rng(1), []
    for _ in range(2):
        light = smooth(rng, 0.02, 20.0)[..., 1]
        shots = []
        for time, k in zip(TIMES, TRUE, strict=True):
            signal = np.minimum(rng.poisson(light * k * 20_000) / 20_000, 1.0)
            if rubbish:
                signal[HIDDEN] = smooth(rng, 0.05, 1.0)[..., 0][HIDDEN]
            pixels = np.rint(64 + 4031 * np.clip(signal, 0, 1)).astype(np.uint16)
            shots.append((RawMosaic(pixels, Cfa.RGGB, ((64.0,),), 4095), Exposure(time=time)))
        views.append(shots)
    return views


def ratio_errors(folder: Path) -> tuple[np.ndarray, float]:
    """ln of the ratios of the exposures over the true ones, and the standard error that is told."""
    session = Session.open(folder)
    views = scene_views(session)
    estimated = exposure_scales.estimate(session, views, unreported)
    logs = np.log([[estimated.scale[shot.file] for shot in view.shots] for view in views]) - np.log(TRUE)
    (rung,) = [rung for rung in estimated.rungs if rung.name == "exposure_ratios"]
    assert rung.standard_error is not None
    return logs - logs.mean(1, keepdims=True), rung.standard_error / 100


def test_exposures_are_those_of_what_no_mask_hides(tmp_path: Path) -> None:
    clean, _ = ratio_errors(make_session(tmp_path / "clean", raw_views(rubbish=False)))
    masked, error = ratio_errors(hide(make_session(tmp_path / "masked", raw_views(rubbish=True))))
    spoilt, _ = ratio_errors(make_session(tmp_path / "spoilt", raw_views(rubbish=True)))
    assert np.abs(clean).max() < 0.003
    assert np.abs(masked).max() < min(3 * error, 0.003)
    assert np.abs(spoilt).max() > 0.02


def test_guessed_exposures_are_of_what_no_mask_hides(tmp_path: Path) -> None:
    """Without labels the brightness of a picture says which exposure is the longer one."""
    views = [[(mosaic, None) for mosaic, _ in shots] for shots in raw_views(rubbish=True)]
    for shots in views:
        shots[2][0].pixels[HIDDEN] = 4095
    masked, _ = ratio_errors(hide(make_session(tmp_path / "masked", views)))
    assert np.abs(masked).max() < 0.003


def developed(*, rubbish: bool) -> list[list[tuple[np.ndarray, Exposure]]]:
    """Four views in three exposures each, as JPEG; hidden edges lie on those of its blocks."""
    rng, views = np.random.default_rng(2), []
    for _ in range(4):
        light, shots = smooth(rng, 1e-2, 8.0), []
        for time in TIMES:
            x = rng.poisson(np.minimum(light * time, 4) * 3000) / 3000
            if rubbish:
                x[HIDDEN] = smooth(rng, 0.02, 0.9)[HIDDEN]
            shots.append((np.rint(255 * srgb_encode(np.clip(x, 0, 1))).astype(np.uint8), Exposure(time=time)))
        views.append(shots)
    return views


def curve_error(folder: Path) -> float:
    """Largest departure of the response from sRGB between codes 40 and 240, ln of light; inf: none found."""
    session = Session.open(folder)
    response = radiometry.measure_light(session, scene_views(session), unreported).responses["cam"]
    if response.kind not in ("curve", "srgb") or response.residual is None:
        return float("inf")
    codes = np.linspace(40, 240, 41)[:, None].repeat(3, 1) / 255
    measured, true = (
        np.log(decode(codes, curve)) for curve in (response, response.model_copy(update={"kind": "srgb"}))
    )
    away = measured - true
    return float(np.abs(away - away.mean(0)).max())


def test_a_response_is_that_of_what_no_mask_hides(tmp_path: Path) -> None:
    assert curve_error(make_session(tmp_path / "clean", developed(rubbish=False))) < 0.05
    assert curve_error(hide(make_session(tmp_path / "masked", developed(rubbish=True)))) < 0.05
    assert curve_error(make_session(tmp_path / "spoilt", developed(rubbish=True))) > 0.1


def test_a_patch_that_one_shot_hides_is_told_by_the_others() -> None:
    """A mask of the middle exposure leaves the other two, and without one nothing changes."""
    light = smooth(np.random.default_rng(3), 0.05, 0.9)
    pixels = [srgb_encode(light * k).astype(np.float32) for k in (1.0, 0.5, 0.25)]
    counts = np.ones((120, 160), bool)
    counts[:, 1:] = False
    samples = sample([patches(pixels[0]), patches(pixels[1], counts), patches(pixels[2])], np.zeros(3), 500)
    assert len(samples.codes) > 300
    assert np.isnan(samples.codes[:, 1]).all()
    assert np.isfinite(samples.codes[:, [0, 2]]).any()
    plain, same = (
        sample([patches(one, whole) for one in pixels], np.zeros(3), 500)
        for whole in (None, np.ones((120, 160), bool))
    )
    np.testing.assert_allclose(plain.codes, same.codes, rtol=1e-6)
    everything = sample([patches(one, np.zeros((120, 160), bool)) for one in pixels], np.zeros(3), 500)
    assert len(everything.codes) == 0


def test_a_sensor_is_measured_by_what_no_mask_hides() -> None:
    """Gain from pairs whose hidden half is filled anew in every shot; not hidden, nothing is told of it."""
    sensor, rng = SimulatedSensor(MODEL, 240, 240, 5, "bracket"), np.random.default_rng(5)
    y, x = np.mgrid[0:240, 0:240] / 120 - 1
    light = np.exp2(2 * np.sin(9 * x + 4 * y) + 3 * x - 4)
    counts = np.ones((240, 240), bool)
    counts[41:200, 61:181] = False
    shots = []
    for amount in (1 / 16, 1 / 2, 4.0):
        shot = sensor.expose(light * MODEL.white_electrons * amount, 0.25 * amount, 1.0, rng)
        shot[~counts] = rng.integers(256, 4096, int((~counts).sum()))
        shots.append(shot)
    black, transfers = np.full(4, 256.0), {}
    for name, counted in (("masked", counts), ("spoilt", None)):
        pairs = [brackets.compare(shots[i + 1], shots[i], black, 4095.0, counted) for i in (0, 1)]
        usable = [pair for pair in pairs if pair is not None]
        transfers[name] = brackets.pooled(usable, 4095.0 - 256.0).transfer if usable else None
    assert transfers["masked"] is not None
    gain, error = brackets.gain(transfers["masked"])
    assert abs(gain - 0.4) < min(3 * error, 0.02)
    assert transfers["spoilt"] is None or abs(brackets.gain(transfers["spoilt"])[0] - 0.4) > 0.05
    assert brackets.compare(shots[1], shots[0], black, 4095.0, counts & False) is None


def test_no_brightness_and_no_verdict_comes_from_behind_a_mask(tmp_path: Path) -> None:
    """All that is not hidden is white: the view is blank, however much there is to see behind the mask."""
    rng = np.random.default_rng(6)
    image = np.full((120, 160, 3), 255, np.uint8)
    image[HIDDEN] = rng.integers(30, 200, (96, 96, 3))
    folder = hide(make_session(tmp_path / "s", [[(image, Exposure(time=1.0))]]))
    session = Session.open(folder)
    (view,) = scene_views(session)
    scale = {view.shots[0].file: 1.0}
    response = radiometry.measure_light(session, [view], unreported).responses["cam"]
    masked = summarise(session, view, scale, response, None)
    assert masked.blank == "saturated"
    assert not np.isfinite(masked.brightness).any()
    bare = view.shots[0].model_copy(update={"mask": None})
    whole = summarise(session, type(view)(view.camera, view.frame, (bare,)), scale, response, None)
    assert whole.blank is None
    assert len(whole.features.points) > len(masked.features.points)
    assert np.isfinite(whole.brightness).any()
