"""Renders and what they should show, side by side on disk, and how different they look.

CIEDE2000 is always reported, FLIP and ColorVideoVDP where they are installed (`recon.measure.flip`,
`recon.measure.vdp`). Other programs find the files there.
"""

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from imaging.arrays import Array32
from imaging.colour.difference import delta_e
from imaging.colour.spaces import srgb_decode
from imaging.compute import memory
from imaging.compute.threads import in_order, one_thread_a_product, thread_count
from imaging.files import store
from imaging.files.photo import encode_png
from imaging.progress import Progress, unreported
from recon.data.dataset import View
from recon.data.light import Images
from recon.measure.flip import Flips, LightPair, Pair
from recon.measure.vdp import Vdp, nits
from recon.rendering.light_files import header_of, stem, write_light
from recon.result.display import displayed, in_colour
from recon.result.opened import Opened

RENDERS, REFERENCES = "renders", "references"
A_PIXEL = 1000
"""Bytes at most that comparing a pixel of a view takes: CIEDE2000 in float64, above all."""


@dataclass(frozen=True, eq=False)
class _Compared:
    """A view whose pictures are written: figures of it, and what FLIP and ColorVideoVDP compare."""

    row: dict[str, float]
    pairs: list[Pair]
    light: LightPair | None


def compare_pictures(
    folder: Path,
    opened: Opened,
    light: Images,
    truth: list[Array32] | None,
    scale: float,
    progress: Progress = unreported,
    until: float = math.inf,
) -> tuple[list[dict[str, float]], list[str]]:
    """Write renders/ and references/ of the reported views, and compare them.

    EXR of both are in the units of the scene, PNG at its exposure; of photographs PNG of every shot of a
    trained exposure instead, as they are.

    Args:
        folder: Of the scene.
        opened: Scene, with its photographs.
        light: Renders of the views, linear [H, W, C], and where each is seen.
        truth: True light of the views [H, W, C]; None where it is not known.
        scale: What aligns the light with the truth.
        progress: Callback for the current step, the steps done, and all of them.
        until: Reading of `time.monotonic` after which neither FLIP nor ColorVideoVDP is begun.

    Returns:
        A row of figures for each view, and the kinds of figures that there was not time for of all.
    """
    views = opened.dataset.reported

    def compared(turn: int) -> _Compared:
        return _compare(
            folder, opened, views[turn], light[turn][0], None if truth is None else truth[turn], scale
        )

    rows, flips, visible = [], Flips(len(views), until), Vdp(len(views), until)
    largest = max((view.lens.width * view.lens.height for view in views), default=1)
    at_once = max(1, min(thread_count(), memory.available() // (A_PIXEL * largest)))
    if not opened.dataset.views[0].held:  # its light is in a file, which one thread reads
        at_once = 1
    with one_thread_a_product(), ThreadPoolExecutor(at_once) as pool:
        for turn, one in enumerate(in_order(pool, len(views), compared, at_once)):
            progress("comparing pictures", turn, len(views))
            row = one.row
            for name, errors in flips.of(one.pairs, one.light).items():
                row |= _summary(name, errors)
            rows.append(row | visible.of(one.pairs, one.light))
    return rows, flips.left_out() + visible.left_out()


def _compare(
    folder: Path, opened: Opened, view: View, light: Array32, truth: Array32 | None, scale: float
) -> _Compared:
    """Write the pictures of one view."""
    header, bands = header_of(opened.record, view.name), opened.record.bands
    write_light(folder / RENDERS / f"{stem(view)}.exr", light, header, bands)
    goal = None
    if truth is not None:
        goal = np.asarray(truth / np.float32(scale), np.float32)
        write_light(folder / REFERENCES / f"{stem(view)}.exr", goal, header, bands)
    shown, goal = in_colour(light, bands), None if goal is None else in_colour(goal, bands)
    pairs = list(_pairs(opened, view, shown, goal))
    for pair in pairs:
        store.write_bytes(folder / RENDERS / f"{pair.name}.png", encode_png(pair.ours))
        store.write_bytes(folder / REFERENCES / f"{pair.name}.png", encode_png(pair.reference))
    row = _summary("ciede2000", [_colour_difference(pair) for pair in pairs])
    shown_at = nits(opened.record.exposure, opened.record.luminance)
    return _Compared(row, pairs, None if goal is None else LightPair(shown, goal, view.valid, shown_at))


def _pairs(opened: Opened, view: View, light: Array32, goal: Array32 | None) -> Iterator[Pair]:
    if view.sensor.kind != "ldr":
        if goal is not None:
            exposure = opened.record.exposure
            yield Pair(stem(view), displayed(light, exposure), displayed(goal, exposure), view.valid)
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
    ours, reference = (srgb_decode(side[pair.valid] / 255.0) for side in (pair.ours, pair.reference))
    return np.asarray(delta_e(ours, reference), np.float32)
