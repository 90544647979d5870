"""RawNeRF's measure of a scene (Mildenhall et al., CVPR 2022), after multinerf's `raw_utils` and `eval`.

A test view is compared with a clean mosaic, a burst merged to one: the signal where the mosaic has it, and
the picture that a simple development makes of both, after each channel of the signal was fitted by a line.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from imaging import metrics
from imaging.arrays import Array, Array32, Floats
from imaging.colour.spaces import XYZ_FROM_REC709, srgb_encode
from imaging.errors import InputError, ReconstructionError
from imaging.files.raw import read_raw
from imaging.sensor.cfa import Cfa, bilinear, mosaic
from imaging.session.falloff import falloff
from imaging.session.paths import session_of
from imaging.session.session import Session
from recon.data.load import lens_of_pixels
from recon.result.model import read_own_calibration
from recon.result.scene import open_scene
from recon.splat import SplatCamera

MERGED_BITS = 2
"""Additional bits of the codes in HDR+'s merged mosaics over those of their shots."""
WHITE_PERCENTILE = 97.0
"""Percentile of the clean picture, linear Rec.709, at which its development turns white."""
BORDER = 16
"""px left out along the edges."""


@dataclass(frozen=True, eq=False)
class Reference:
    """A clean mosaic. signal: float32 [H, W], black 0 and white 1 at the exposure of the training.

    rec709_from_camera: float64 [3, 3], with white balance.
    """

    signal: Array32
    cfa: Cfa
    rec709_from_camera: Array


def read_reference(merged: Path, shot: Path, ratio: float) -> Reference:
    """Read the clean mosaic of a test scene, with the levels and the colours of a shot of the training's
    exposure.

    ratio: exposure of that shot over the exposure of those that were merged. InputError if a file is damaged,
    the two differ in size or phase, or the shot has no colours.
    """
    clean, raw = read_raw(merged), read_raw(shot)
    if (clean.pixels.shape, clean.cfa) != (raw.pixels.shape, raw.cfa):
        raise InputError(f"{merged} and {shot} differ in size or colour filters: copy the scene again.")
    if raw.cfa is None or raw.cfa.letters != "RGB":
        raise InputError(f"{shot} is not a mosaic of red, green and blue: copy the scene again.")
    if raw.neutral is None or raw.camera_from_xyz is None:
        raise InputError(f"{shot} has no white balance or no colour matrix of RGB: copy the scene again.")
    black = raw.black_map()
    signal = (clean.pixels / 2.0**MERGED_BITS - black) / (raw.white - black) * ratio
    matrix = rec709_from_camera(raw.neutral, raw.camera_from_xyz)
    return Reference(np.asarray(signal, np.float32), raw.cfa, matrix)


def rec709_from_camera(neutral: npt.ArrayLike, camera_from_xyz: npt.ArrayLike) -> Array:
    """Camera RGB to linear Rec.709, float64 [3, 3], white balanced: `neutral` [3] becomes (1, 1, 1).

    camera_from_xyz [3, 3]: a DNG ColorMatrix, whose rows lead from Rec.709's white to 1, as in the
    simple-camera-pipeline that multinerf follows.
    """
    balanced = np.asarray(camera_from_xyz, np.float64) @ XYZ_FROM_REC709
    balanced /= balanced.sum(axis=1, keepdims=True)
    return np.asarray(np.linalg.inv(balanced) @ np.diag(1 / np.asarray(neutral, np.float64)))


def score(prediction: Floats, reference: Reference) -> dict[str, float]:
    """Score camera RGB [H, W, 3] in the unit of the reference: `raw_psnr`, `rgb_psnr`, `rgb_ssim`.

    raw_psnr, dB: of the mosaic, both clipped at white, which is the peak. rgb_psnr (dB) and rgb_ssim: of the
    developed pictures after the affine fit, to which the prediction comes clipped too: otherwise a lamp
    brighter than the sensor's range would dominate the fit. All without a border of 16 px; ValueError if no
    pixels are left.
    """
    inner = slice(BORDER, -BORDER), slice(BORDER, -BORDER)
    prediction, signal = np.minimum(prediction, 1.0), np.minimum(reference.signal, 1.0)
    raw = metrics.psnr(mosaic(prediction, reference.cfa)[inner], signal[inner])
    clean = bilinear(signal, reference.cfa)[0].astype(np.float64)
    white = float(np.percentile(clean @ reference.rec709_from_camera.T, WHITE_PERCENTILE))
    ours, true = (
        developed(picture, reference.rec709_from_camera, white)[inner]
        for picture in (affine_aligned(prediction, clean), clean)
    )
    similarity = metrics.ssim(ours, true)
    assert similarity is not None  # no sample is masked
    return {"raw_psnr": raw, "rgb_psnr": metrics.psnr(ours, true), "rgb_ssim": similarity}


def affine_aligned(estimate: Floats, truth: Floats) -> Array:
    """An estimate [H, W, C] moved and scaled in each channel to fit the truth, float64.

    As in multinerf the line is fitted from the truth to the estimate, whose noise then does not flatten it,
    and inverted. A channel in which the two have nothing in common is only moved.
    """
    x, y = (np.asarray(picture, np.float64) for picture in (truth, estimate))
    mean_x, mean_y = x.mean(axis=(0, 1)), y.mean(axis=(0, 1))
    covariance = ((x - mean_x) * (y - mean_y)).mean(axis=(0, 1))
    variance = ((x - mean_x) ** 2).mean(axis=(0, 1))
    alike = (variance > 0) & (np.abs(covariance) > 1e-12 * variance)
    slope = np.where(alike, covariance / np.where(variance > 0, variance, 1.0), 1.0)
    return np.asarray((y - mean_y) / slope + mean_x)


def developed(camera_rgb: Floats, matrix: Array, white: float) -> Array:
    """sRGB codes 0..1, float64 [H, W, 3]: colours by a matrix [3, 3], `white` at 1, clipped, encoded."""
    light = np.asarray(camera_rgb, np.float64) @ matrix.T
    return np.asarray(srgb_encode(light / (white if white > 0 else 1.0)), np.float64)


def measure(folder: Path, merged: Path) -> dict[str, float]:
    """`score` of the test view of a scene in its session, SESSION/reconstructions/NAME, at full resolution.

    The session is one that was imported from a test scene: the first shot of its test view has the exposure
    of the training, its last one that of the burst which was merged to `merged`. InputError or
    ReconstructionError if any of that is missing or damaged.
    """
    scene, session = open_scene(folder), Session.open(session_of(folder) or folder.parent.parent)
    tested = [view for view in scene.views if view.use != "training"]
    if len(tested) != 1:
        raise ReconstructionError(
            f"{folder} has {len(tested)} held-out views and a test scene of RawNeRF one: import it again."
        )
    (view,) = tested
    shots = sorted(
        (shot for shot in session.shots("scene") if shot.view == view.id), key=lambda shot: shot.step
    )
    calibration = read_own_calibration(folder)
    exposed = [calibration.exposure_scale[shot.file] for shot in (shots[0], shots[-1])]
    reference = read_reference(merged, session.file(shots[0]), exposed[0] / exposed[1])
    height, width = (side - side % 2 for side in reference.signal.shape)
    reference = replace(reference, signal=reference.signal[:height, :width])
    camera = calibration.camera(view.camera)
    assert camera.lens is not None  # the view was trained with it
    lens = lens_of_pixels(camera.lens, "raw", width, height)
    light = scene.render(SplatCamera.of(lens, view.cam_from_world))
    matrix = np.asarray(camera.camera_from_rec709 or np.eye(3), np.float64)
    signal = light @ matrix.T * falloff(camera, height, width)[..., None] * exposed[0]
    return score(signal, reference)
