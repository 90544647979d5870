"""Figures of the held-out views of a scene: against the truth, if it is known, and against the shots."""

import itertools
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import torch

from imaging import metrics
from imaging.arrays import Array32, Mask
from imaging.progress import Progress, unreported
from recon.data.dataset import Dataset, View
from recon.data.light import Images, kept_images
from recon.data.shot import Shot
from recon.measure.recorded_light import RecordedLight, against_photographs, recorded_light
from recon.measure.truth import has_truth, true_radiance
from recon.observe.shot_comparison import as_recorded, shot_psnr
from recon.result.opened import Opened

DISPLAY_PEAK = 1000.0
"""cd/m2 at which PU21 takes the truth's maximum."""


def measured(
    opened: Opened, progress: Progress = unreported
) -> tuple[Images, list[float], list[dict[str, Any]], dict[str, Any]]:
    """Measure each reported view: light [H, W, 3] with its mask, seconds a render and figures; and the
    pooled values.
    """
    views = opened.dataset.reported
    seconds: list[float] = []
    rows: list[dict[str, Any]] = [{"view": view.name} for view in views]
    reference = reference_light(opened) if views else None
    recorded: list[RecordedLight] = []

    def each() -> Iterator[tuple[Array32, Mask]]:
        for done, view in enumerate(views):
            progress("rendering held-out views", done, len(views))
            started = time.perf_counter()
            image = opened.render(view.lens)
            seconds.append(time.perf_counter() - started)
            _against_shots(opened, image, view, rows[done])
            if reference is None and not opened.dataset.bands:
                recorded.append(recorded_light(opened.training.method.observation, image, view))
            light = opened.training.method.observation.radiance(image)
            yield light.numpy().astype(np.float32), view.valid

    light = kept_images(opened.dataset, each())
    pooled: dict[str, Any] = {}
    if reference is None:
        _against_exr(views, light, rows)
    if recorded:
        pooled = against_photographs(recorded)
    elif reference is not None:
        # What a mask hides is no part of any figure.
        ours = [image[unmasked] for image, unmasked in light]
        true = [goal[unmasked] for goal, (_, unmasked) in zip(reference, light, strict=True)]
        pooled = _against_light(ours, true, rows)
        if opened.dataset.bands and pooled:
            pooled["bands"] = _by_band(opened, ours, true, pooled["alignment_scale"])
    return light, seconds, rows, pooled


def reference_light(opened: Opened) -> list[Array32] | None:
    """The true light of the held-out views: of the simulator, or of EXR files; None without either."""
    if has_truth(opened.dataset.session):
        return [
            true_radiance(opened.dataset.session, view, opened.dataset.bands)
            for view in opened.dataset.reported
        ]
    if opened.dataset.kind == "hdr":
        return [_light_of_exr(view) for view in opened.dataset.reported]
    return None


def _light_of_exr(view: View) -> Array32:
    """Light of a view of EXR before the lens, float32 [H, W, 3]: the file has the falloff of the lens."""
    shot = view.shots[-1]
    return np.asarray(shot.pixels / np.float32(shot.k) / view.sensor.falloff[..., None], np.float32)


def has_figure(dataset: Dataset, view: View) -> bool:
    """Return whether a held-out view can be measured: masks leave some of it, and of photographs without
    truth a shot of an exposure that training saw.
    """
    if view.sensor.kind != "ldr" or has_truth(dataset.session):
        return bool(view.valid.any())
    return any(shot.valid.any() for shot in view.shots if dataset.trained_at(shot.k))


def _against_light(light: list[Array32], truth: list[Array32], rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Fills the rows; returns what is pooled over the views. A view that is masked altogether is left out."""
    unmasked = [turn for turn, goal in enumerate(truth) if goal.size]
    if not unmasked:
        return {}
    light, truth = [light[turn] for turn in unmasked], [truth[turn] for turn in unmasked]
    rows = [rows[turn] for turn in unmasked]
    peak = max(0.0, *(float(image.max()) for image in truth))
    # Views of several cameras may differ in size: pooled, they are plain pixels.
    everything, true = (
        np.concatenate([image.reshape(-1, image.shape[-1]) for image in side]) for side in (light, truth)
    )
    scale = metrics.align_scale(everything, true)
    most = max(0.0, float(np.percentile(true, 99.9)))
    for row, image, goal in zip(rows, light, truth, strict=True):
        aligned = image * scale
        row["hdr_psnr_mu"] = metrics.hdr_psnr_mu(image, goal, peak)
        row["hdr_psnr_mu_aligned"] = metrics.hdr_psnr_mu(aligned, goal, peak)
        row["hdr_psnr_mu_dark"] = metrics.hdr_psnr_mu_dark(aligned, goal, peak)
        row["hdr_psnr_mu_p999"] = metrics.hdr_psnr_mu_below(aligned, goal, most)
        row["stops_median"] = metrics.stops_median(aligned, goal)
        row["pu21_psnr"] = metrics.pu21_psnr(aligned, goal, DISPLAY_PEAK, peak)
    return {
        "stops_median": metrics.stops_median(everything * scale, true),
        **{
            f"stops_{name}": metrics.stops_median(everything * scale, true, among)
            for name, among in metrics.LIGHT.items()
        },
        "stops_against": "truth",
        "relative_error_by_decade": metrics.relative_error_by_decade(everything * scale, true),
        "alignment_scale": scale,
        "truth_peak": peak,
        "truth_p999": most,
        "pu21_display_peak": DISPLAY_PEAK,
    }


def _against_exr(views: Sequence[View], light: Images, rows: list[dict[str, Any]]) -> None:
    """Fills the rows of a mixed rig's EXR views, relative to the brightest light of them all."""
    pairs = {}
    for turn, view in enumerate(views):
        if view.sensor.kind == "hdr" and view.valid.any():
            image, unmasked = light[turn]
            pairs[turn] = image[unmasked], _light_of_exr(view)[unmasked]
    peak = max([0.0, *(float(goal.max()) for _, goal in pairs.values())])
    for turn, (image, goal) in pairs.items():
        rows[turn]["hdr_psnr_mu"] = metrics.hdr_psnr_mu(image, goal, peak)


@torch.no_grad()
def _against_shots(opened: Opened, image: torch.Tensor, view: View, row: dict[str, Any]) -> None:
    """Fills the row of a view with the distance from what the cameras recorded, mean over the bracket.

    Photographs at exposures that training saw (`_oe`, `ssim`) are apart from those at others (`_ne`). What is
    masked counts in none, SSIM's windows that touch it included; a shot that is masked altogether has none.
    """
    if view.sensor.kind == "hdr":
        return
    predicted = [
        opened.training.method.observation.predict(image, view, shot.k, shot.band) for shot in view.shots
    ]
    if view.sensor.kind == "raw":
        _note(row, "raw_psnr", map(shot_psnr, predicted, view.shots))
        return
    at_trained = [opened.dataset.trained_at(shot.k) for shot in view.shots]
    for trained, suffix in ((True, "oe"), (False, "ne")):
        pairs = [
            (prediction, shot)
            for prediction, shot, is_trained in zip(predicted, view.shots, at_trained, strict=True)
            if is_trained == trained
        ]
        _note(row, f"ldr_psnr_{suffix}", itertools.starmap(shot_psnr, pairs))
        if min(view.lens.width, view.lens.height) >= 11:
            _note(row, "ssim" if trained else "ssim_ne", itertools.starmap(_ssim, pairs))
        if trained and view.transparent:
            alpha = opened.scene.covered(view.lens)
            _note(row, "ldr_psnr_white", (_psnr_before_white(*pair, alpha) for pair in pairs))


def _by_band(
    opened: Opened, light: list[Array32], truth: list[Array32], scale: float
) -> list[dict[str, Any]]:
    """Figures of each band: raw_psnr of its shots, and errors of its true light; the scale is that of all
    bands.
    """
    ours, true = (
        np.concatenate([image.reshape(-1, image.shape[-1]) for image in side]) for side in (light, truth)
    )
    figures = []
    for number, band in enumerate(opened.dataset.bands):
        row: dict[str, Any] = {"band": band.name}
        psnrs = (
            shot_psnr(opened.training.method.observation.predict(image, view, shot.k, number), shot)
            for view in opened.dataset.reported
            for image in (opened.render(view.lens),)
            for shot in view.shots
            if shot.band == number
        )
        _note(row, "raw_psnr", psnrs)
        row["hdr_psnr_mu_aligned"] = metrics.hdr_psnr_mu(ours[:, number] * scale, true[:, number])
        row["stops_median"] = metrics.stops_median(ours[:, number] * scale, true[:, number])
        figures.append(row)
    return figures


def _note(row: dict[str, Any], key: str, figures: Iterable[float | None]) -> None:
    """Put the mean of the available figures into the row."""
    present = [figure for figure in figures if figure is not None]
    if present:
        row[key] = float(np.mean(present))


def _psnr_before_white(predicted: torch.Tensor, shot: Shot, alpha: torch.Tensor) -> float | None:
    """PSNR of a photograph with alpha, code 1 behind it and behind the render, whose alpha is [H, W]."""
    if shot.alpha is None:
        return None
    white = shot.showing(pixels=shot.pixels + (1 - shot.alpha)[..., None])
    return shot_psnr(predicted + (1 - alpha)[..., None], white)


def _ssim(predicted: torch.Tensor, shot: Shot) -> float | None:
    clipped, recorded = as_recorded(predicted, shot)
    return metrics.ssim(clipped.numpy(), recorded.numpy(), shot.valid)
