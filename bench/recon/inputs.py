"""A RAW session as different programs would train on it: brackets, one exposure, merged, demosaicked."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from skimage.restoration import denoise_nl_means

from imaging.arrays import Array32, Mask
from imaging.colour.spaces import rec709_from_camera
from imaging.demosaicking.demosaic import demosaic
from imaging.merge.bracket import merge_bracket
from imaging.merge.linear_frame import SensorSignalNoise
from imaging.sensor.cfa import bilinear
from recon.data.dataset import Dataset, Sensor, View
from recon.data.light import radiance_image
from recon.data.shot import HeldPlanes, Shot

Picture = Callable[[View], tuple[Array32, Mask]]


def brackets(dataset: Dataset) -> Dataset:
    """Observe as `rig reconstruct` does: every exposure of a view is an observation of its own."""
    return dataset


def merged(dataset: Dataset, picture: Picture = radiance_image) -> Dataset:
    """Each bracket merged (at the Cramer-Rao bound) and demosaicked: linear Rec.709, as in an EXR."""
    return _with(dataset, lambda view: _merged(view, picture))


def bilinear_image(view: View) -> tuple[Array32, Mask]:
    """Demosaic bilinearly, otherwise as `radiance_image`."""
    sensor = view.sensor
    assert sensor.cfa is not None
    merged = merge_bracket([shot.linear(None, sensor.cfa) for shot in view.shots])
    rgb, known = bilinear(np.nan_to_num(merged.radiance, nan=0.0) / sensor.falloff, sensor.cfa)
    light = np.asarray(rgb @ rec709_from_camera(sensor.camera_from_rec709).T, np.float32)
    return light, np.asarray(known.all(-1))


def merged_mosaic(dataset: Dataset) -> Dataset:
    """Each bracket merged, but not demosaicked."""
    return _with(dataset, _merged_mosaic)


def demosaicked(dataset: Dataset) -> Dataset:
    """Every exposure on its own, demosaicked."""
    return _with(dataset, _demosaicked)


def denoised(dataset: Dataset, strength: float) -> Dataset:
    """Demosaic every exposure, and denoise it before training, as programs that enhance first do.

    Non-local means (Buades et al. 2005) of the picture on the scale on which its noise is constant.

    Args:
        dataset: A RAW session with its noise.
        strength: Filter parameter h, over the standard deviation of the noise.
    """
    return _with(dataset, lambda view: _denoised(_demosaicked(view), strength))


def _with(dataset: Dataset, change: Callable[[View], View]) -> Dataset:
    """Training views changed; the held-out ones stay what the cameras recorded."""
    return replace(dataset, train=tuple(change(view) for view in dataset.train))


def _merged(view: View, picture: Picture) -> View:
    rgb, _ = picture(view)
    everywhere = np.ones(rgb.shape, bool)
    shot = Shot(view.shots[0].file, 1.0, HeldPlanes(rgb, ~everywhere, ~everywhere, everywhere))
    plain = np.ones(rgb.shape[:2], np.float32)
    return replace(view, shots=(shot,), sensor=Sensor("hdr", None, np.eye(3), plain, view.sensor.response))


def _merged_mosaic(view: View) -> View:
    merged = merge_bracket([shot.linear(None, view.sensor.cfa) for shot in view.shots])
    light = np.ascontiguousarray(np.nan_to_num(merged.radiance, nan=0.0), np.float32)
    never = np.zeros(light.shape, bool)
    return replace(
        view,
        shots=(Shot(view.shots[0].file, 1.0, HeldPlanes(light, never, never, np.isfinite(merged.radiance))),),
    )


def _demosaicked(view: View) -> View:
    cfa = view.sensor.cfa
    assert cfa is not None
    shots = []
    for shot in view.shots:
        sigma = None if shot.noise is None else np.sqrt(shot.noise.variance(shot.pixels))
        demosaicked = demosaic(shot.pixels, cfa, shot.valid, sigma)
        clipped = bilinear(shot.saturated.astype(np.float32), cfa)[0] > 0
        shots.append(
            shot.showing(
                pixels=demosaicked.rgb,
                saturated=clipped,
                dark=np.zeros(clipped.shape, bool),
                valid=demosaicked.known,
            )
        )
    return replace(view, shots=tuple(shots), sensor=replace(view.sensor, cfa=None))


def _denoised(view: View, strength: float) -> View:
    return replace(view, shots=tuple(shot.showing(pixels=_smooth(shot, strength)) for shot in view.shots))


def _smooth(shot: Shot, strength: float) -> Array32:
    noise = shot.noise
    assert isinstance(noise, SensorSignalNoise)
    # Anscombe's scale: the noise of a photosite is 1 everywhere, and of either sign about black.
    root = np.sqrt(noise.slope * np.abs(shot.pixels) + noise.floor) - noise.floor**0.5
    stable = np.copysign(root * (2 / noise.slope), shot.pixels)
    smooth = denoise_nl_means(
        stable, patch_size=5, patch_distance=6, h=strength, sigma=0.0, fast_mode=True, channel_axis=-1
    )
    root = np.abs(smooth) * (noise.slope / 2) + noise.floor**0.5
    return np.asarray(np.copysign((root**2 - noise.floor) / noise.slope, smooth), np.float32)
