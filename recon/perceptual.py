"""Renders and what they should show, side by side on disk, and how different they look.

CIEDE2000 is always reported, FLIP where it is installed (`pip install -e '.[metrics]'`): of pictures
(Andersson et al., HPG 2020) and of light (HDR-FLIP, EGSR 2021). Other programs find the files there.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imaging.arrays import Array32, Bytes, Mask
from imaging.colour import srgb_decode
from imaging.colour_difference import delta_e
from imaging.files import store
from imaging.files.photo import encode_png
from imaging.progress import Progress, unreported
from recon.data.dataset import View
from recon.data.light import Images
from recon.rendering.light_files import stem, write_light
from recon.result.display import displayed, in_colour
from recon.result.scene import Opened

RENDERS, REFERENCES = "renders", "references"
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
ACES_TOP = 2.1188723239873153
"""Light that the tone curve of HDR-FLIP, Narkowicz's fit of ACES at 0.6 times the light, takes to 0.85."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A render and its reference as a display shows them, sRGB [H, W, 3]; seen [H, W]: not masked."""

    name: str
    ours: Bytes
    reference: Bytes
    seen: Mask


def compare_pictures(
    folder: Path,
    opened: Opened,
    light: Images,
    truth: list[Array32] | None,
    scale: float,
    progress: Progress = unreported,
) -> list[dict[str, float]]:
    """Write renders/ and references/ of the reported views; a row of figures for each of them.

    light: of the views, [H, W, 3], and where it is seen; truth: light, if it is known; scale: what aligns the
    light with it.
    EXR of both are in the units of the scene, PNG at its exposure; of photographs PNG of every shot of a
    trained exposure instead, as they are.
    """
    rows = []
    for turn, view in enumerate(opened.dataset.reported):
        progress("comparing pictures", turn, len(light))
        write_light(folder / RENDERS / f"{stem(view)}.exr", light[turn][0], opened.record, view.name)
        goal = None
        if truth is not None:
            goal = np.asarray(truth[turn] / np.float32(scale), np.float32)
            write_light(folder / REFERENCES / f"{stem(view)}.exr", goal, opened.record, view.name)
        bands = opened.record.bands
        shown, goal = in_colour(light[turn][0], bands), None if goal is None else in_colour(goal, bands)
        pairs = list(_pairs(opened, view, shown, goal))
        for pair in pairs:
            store.write_bytes(folder / RENDERS / f"{pair.name}.png", encode_png(pair.ours))
            store.write_bytes(folder / REFERENCES / f"{pair.name}.png", encode_png(pair.reference))
        row = _summary("ciede2000", [_colour_difference(pair) for pair in pairs])
        if find_spec("flip_evaluator") is not None:
            row |= _summary("flip", [errors for pair in pairs if (errors := _flip(pair)) is not None])
            if goal is not None:
                errors = hdr_flip(shown, goal, view.seen)
                row |= _summary("hdr_flip", [] if errors is None else [errors])
        rows.append(row)
    return rows


def _pairs(opened: Opened, view: View, light: Array32, goal: Array32 | None) -> Iterator[Pair]:
    if view.sensor.kind != "ldr":
        if goal is not None:
            exposure = opened.record.exposure
            yield Pair(stem(view), displayed(light, exposure), displayed(goal, exposure), view.seen)
        return
    image = opened.render(view.lens)
    for number, shot in enumerate(view.shots):
        if opened.dataset.trained_at(shot.k):
            with torch.no_grad():
                prediction = opened.training.method.observation.predict(image, view, shot.k).numpy()
            ours, reference = (
                np.asarray(np.rint(255 * np.clip(side, 0, 1)), np.uint8) for side in (prediction, shot.pixels)
            )
            yield Pair(f"{stem(view)}_{number}", ours, reference, np.asarray(shot.valid.all(-1)))


def _summary(name: str, maps: list[Array32]) -> dict[str, float]:
    """Mean and median of the pixels of all pictures; empty without pictures."""
    pixels = np.concatenate([errors.reshape(-1) for errors in maps]) if maps else np.empty(0)
    if not pixels.size:
        return {}
    return {f"{name}_mean": float(pixels.mean(dtype=np.float64)), f"{name}_median": float(np.median(pixels))}


def _colour_difference(pair: Pair) -> Array32:
    """CIEDE2000 of the pixels that are seen."""
    ours, reference = (srgb_decode(side[pair.seen] / 255.0) for side in (pair.ours, pair.reference))
    return np.asarray(delta_e(ours, reference), np.float32)


def _flip(pair: Pair) -> Array32 | None:
    ours, reference = (np.asarray(side / np.float32(255), np.float32) for side in (pair.ours, pair.reference))
    return _compared(ours, reference, pair.seen, "LDR", {})


def hdr_flip(light: Array32, truth: Array32, seen: Mask) -> Array32 | None:
    """HDR-FLIP of the pixels that are seen, of linear Rec.709 [H, W, 3]; None where it has no exposures.

    Its exposures are those that FLIP finds by itself, from the one at which the median of the truth is bright
    to the one at which its maximum is. They are given to it since it ends the process where they coincide.
    """
    luminance = np.maximum(truth, 0) @ LUMINANCE
    middle, top = float(np.median(luminance)), float(luminance.max())
    if not 0 < middle < top or not math.isfinite(top / middle):
        return None
    ours, reference = (np.maximum(side / np.float32(middle), 0) for side in (light, truth))
    start, stop = math.log2(ACES_TOP * middle / top), math.log2(ACES_TOP)
    exposures = {
        "startExposure": start,
        "stopExposure": stop,
        "numExposures": max(2, math.ceil(stop - start)),
    }
    return _compared(ours, reference, seen, "HDR", exposures)


def _compared(
    ours: Array32, reference: Array32, seen: Mask, kind: str, parameters: dict[str, Any]
) -> Array32 | None:
    if not seen.any():
        return None
    import flip_evaluator

    # What is masked is alike, so that it does not shine into its neighbours.
    ours = np.where(seen[..., None], ours, reference)
    errors = flip_evaluator.evaluate(
        np.ascontiguousarray(reference), np.ascontiguousarray(ours), kind, True, False, True, parameters
    )
    return np.asarray(errors[0][..., 0][seen], np.float32)
