"""What the files of a session show: how much is clipped, how much is dark, and a thumbnail a view."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from imaging.cfa import cell_means
from imaging.colour import balanced, srgb_decode
from imaging.errors import RigError
from imaging.files.photo import read_photo
from imaging.files.radiance_hdr import read_light
from imaging.files.raw import read_raw
from imaging.progress import Progress
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from rig.report.charts.pictures import developed, fitted, jpeg_uri, three_exposures

Float = npt.NDArray[np.float32]
Bool = npt.NDArray[np.bool_]

MOST_VIEWS = 24
"""Views that are looked at; of a larger session an even choice."""
THUMBNAIL_WIDTH = 256
CLIPPED, DARK = 0.996, 0.004
"""Of the code range or RAW signal: above the first no light is told apart, below the second hardly."""


@dataclass(frozen=True)
class ShotPreview:
    """A shot's file: share of samples that are clipped, share that is dark; linear rgb at low resolution.

    developed: whether the camera made a picture of it, which is then shown as it is.
    """

    clipped: float
    dark: float
    rgb: Float
    valid: Bool
    developed: bool = False


@dataclass(frozen=True)
class Thumbnail:
    """A view as a picture in the page."""

    uri: str
    camera: str
    frame: int


@dataclass(frozen=True)
class ShotPreviews:
    """What was seen: shares by file, thumbnails, how many views of how many, files that cannot be read."""

    shares: dict[str, tuple[float, float]]
    thumbnails: tuple[Thumbnail, ...]
    merged: bool
    views: int
    of_views: int
    unreadable: tuple[str, ...]


def read_previews(session: Session, progress: Progress) -> ShotPreviews:
    """Read an even choice of a session's views."""
    groups = brackets(session.shots("scene"))
    views = sorted(groups)
    step = max(1, -(-len(views) // MOST_VIEWS))
    # Every step-th view, shifted by one each round, so that the cameras take turns.
    chosen = (
        [view for index, view in enumerate(views) if (index + index // step) % step == 0]
        if step > 1
        else views
    )
    shares: dict[str, tuple[float, float]] = {}
    thumbnails, unreadable = [], []
    for done, view in enumerate(chosen):
        progress("looking at the pictures", done, len(chosen))
        previews = []
        for shot in groups[view]:
            try:
                preview = read_preview(session, shot)
            except RigError:
                unreadable.append(shot.file)
                continue
            shares[shot.file] = (preview.clipped, preview.dark)
            previews.append((shot, preview))
        if previews:
            thumbnails.append(Thumbnail(jpeg_uri(_thumbnail(previews), 80), view.camera, view.frame))
    merged = any(len(groups[view]) > 1 for view in chosen)
    return ShotPreviews(shares, tuple(thumbnails), merged, len(chosen), len(views), tuple(unreadable))


def read_preview(session: Session, shot: ShotRecord) -> ShotPreview:
    """Read one shot's file for the page."""
    path, kind = session.file(shot), session.camera(shot.camera).kind
    if kind == "raw":
        raw = read_raw(path)
        signal, clipped = raw.signal(), raw.saturated()
        rgb = balanced(cell_means(signal, raw.cfa), raw.neutral)
        valid = cell_means(clipped, raw.cfa).max(-1) == 0
        return ShotPreview(float(clipped.mean()), float((signal < DARK).mean()), *_reduced(rgb, valid))
    if kind == "hdr":
        rgb = read_light(path)
        return ShotPreview(0.0, 0.0, *_reduced(rgb, np.ones(rgb.shape[:2], bool)))
    photo = read_photo(path)
    top = 2**photo.bit_depth - 1
    # There are far fewer codes than samples.
    codes = np.rint(photo.pixels * np.float32(top)).astype(np.uint16)
    levels = np.linspace(0.0, 1.0, top + 1)
    counts = np.bincount(codes.ravel(), minlength=top + 1) / codes.size
    linear = srgb_decode(levels).astype(np.float32)[codes]
    reduced = _reduced(linear, codes <= CLIPPED * top)
    return ShotPreview(
        float(counts[levels > CLIPPED].sum()), float(counts[levels < DARK].sum()), *reduced, developed=True
    )


def _reduced(rgb: Float, valid: Bool) -> tuple[Float, Bool]:
    """Averaged to about the width of a thumbnail; a pixel is valid if all it was made of is.

    valid: [H, W], or [H, W, 3] by sample.
    """
    factor = max(1, min(rgb.shape[1] // THUMBNAIL_WIDTH, rgb.shape[0]))
    height, width = rgb.shape[0] // factor, rgb.shape[1] // factor

    def averaged(picture: Float) -> Float:
        cut = picture[: height * factor, : width * factor]
        return np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA), np.float32)

    trusted = averaged((~valid).astype(np.float32)) == 0
    return averaged(rgb), np.asarray(trusted.all(-1) if trusted.ndim == 3 else trusted, np.bool_)


def _thumbnail(previews: Sequence[tuple[ShotRecord, ShotPreview]]) -> npt.NDArray[np.uint8]:
    """A view as one picture: a single photograph as it is, else its bracket merged."""
    if len(previews) == 1 and previews[0][1].developed:
        return fitted(developed(previews[0][1].rgb, 0.0), THUMBNAIL_WIDTH)
    return _merged(previews)


def _merged(previews: Sequence[tuple[ShotRecord, ShotPreview]]) -> npt.NDArray[np.uint8]:
    """A bracket as one picture: light summed over time where no shot is clipped, then compressed."""
    by_size: dict[tuple[int, ...], list[tuple[float, ShotPreview]]] = defaultdict(list)
    for shot, preview in previews:
        by_size[preview.rgb.shape].append((shot.exposure.scale if shot.exposure else 1.0, preview))
    same = max(by_size.values(), key=len)
    shortest = min(same, key=lambda pair: pair[0])
    light = np.zeros_like(shortest[1].rgb)
    time = np.zeros(light.shape[:2], np.float32)
    for k, preview in same:
        weight = preview.valid.astype(np.float32)
        light += preview.rgb * weight[..., None]
        time += k * weight
    never = time == 0
    radiance = np.where(
        never[..., None], shortest[1].rgb / shortest[0], light / np.where(never, 1.0, time)[..., None]
    )
    return fitted(compressed(np.maximum(radiance, 0.0)), THUMBNAIL_WIDTH)


def compressed(radiance: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """One picture that shows a wide range: light up to the middle as it is, highlights by their logarithm.

    A gain that depends on the brightest channel alone keeps the hue of lamps and reflections.
    """
    light = np.maximum(radiance, 0.0) * 2.0 ** (three_exposures(radiance)[1] + 0.5)
    level = light.max(-1, keepdims=True)
    top = max(float(np.percentile(level, 99.8)), 1.0)
    gain = np.log1p(level) / np.log1p(top) / np.maximum(level, 1e-9)
    # Where the range is wide the logarithm alone would leave the middle dark.
    lift = min(0.18 / max(float(np.median(light.mean(-1) * gain[..., 0])), 1e-9), 6.0)
    shown = light * gain * lift
    return developed(shown / (1.0 + shown * (1.0 - 1.0 / lift)) if lift > 1 else shown, 0.0)
