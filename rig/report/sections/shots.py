"""Shares of clipped and dark pixels in the files of a session, and a thumbnail a view."""

import math
import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from imaging.arrays import Array32, Bytes, Floats, Mask
from imaging.colour.spaces import balanced, srgb_decode
from imaging.compute import memory
from imaging.compute.threads import in_order, one_thread_a_product, thread_count
from imaging.errors import RigError
from imaging.files.photo import read_photo
from imaging.files.radiance_hdr import read_light
from imaging.files.raw import read_raw
from imaging.optics.pose import upright
from imaging.progress import Progress
from imaging.sensor.cfa import cell_means
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from rig.report.charts.pictures import developed, fitted, jpeg_uri, three_exposures

MOST_VIEWS = 24
"""Most views read; of a larger session an even choice."""
GOLDEN = 0.6180339887498949
"""Golden ratio of the order in which views are read: those read when time is up are spread evenly."""
THUMBNAIL_WIDTH = 256
BAND = 256
"""Rows of a photograph that are worked on at a time."""
CLIPPED, DARK = 0.996, 0.004
"""Thresholds as shares of the code range or RAW signal: above the first light is clipped, below the second
hardly measurable.
"""


@dataclass(frozen=True)
class ShotPreview:
    """A shot's file: share of samples that are clipped, share that is dark; linear rgb at low resolution.

    developed: whether the camera made a picture of it, which is then shown as it is. orientation: as EXIF
    states it of the picture as stored.
    """

    clipped: float
    dark: float
    rgb: Array32
    valid: Mask
    developed: bool = False
    orientation: int = 1


@dataclass(frozen=True)
class Thumbnail:
    """A view as a picture in the page; name: of its first photograph, empty if it was not imported."""

    uri: str
    camera: str
    frame: int
    name: str


@dataclass(frozen=True)
class ShotPreviews:
    """Read shots: shares by file, thumbnails, number of views read and in all, unreadable files."""

    shares: dict[str, tuple[float, float]]
    thumbnails: tuple[Thumbnail, ...]
    merged: bool
    views: int
    of_views: int
    unreadable: tuple[str, ...]


def read_previews(session: Session, progress: Progress, until: float = math.inf) -> ShotPreviews:
    """Read an even choice of a session's views, each once, on as many cores as there is memory for.

    until: reading of `time.monotonic` from which on no view is begun but the first; those that are read by
    then are an even choice as well.
    """
    groups = brackets(session.shots("scene"))
    views = sorted(groups)
    step = max(1, -(-len(views) // MOST_VIEWS))
    # Every step-th view, shifted by one each round, so that the cameras take turns.
    chosen = (
        [view for index, view in enumerate(views) if (index + index // step) % step == 0]
        if step > 1
        else views
    )
    order = sorted(range(len(chosen)), key=lambda index: index * GOLDEN % 1)

    def looked_at(turn: int) -> _Looked | None:
        if turn and time.monotonic() >= until:
            return None
        return _look(session, groups[chosen[order[turn]]])

    views_read: dict[int, _Looked] = {}
    largest = max((shot.width * shot.height for shots in groups.values() for shot in shots), default=1)
    at_once = max(1, min(thread_count(), memory.available() // (3 * memory.PER_SAMPLE * largest)))
    with one_thread_a_product(), ThreadPoolExecutor(at_once) as pool:
        for turn, looked in enumerate(in_order(pool, len(order), looked_at, at_once)):
            progress("looking at the pictures", turn, len(order))
            if looked is not None:
                views_read[order[turn]] = looked
    names = session.photograph_names()
    thumbnails = [
        Thumbnail(
            views_read[index].uri, chosen[index].camera, chosen[index].frame, names.get(chosen[index], "")
        )
        for index in sorted(views_read)
        if views_read[index].uri
    ]
    return ShotPreviews(
        shares={file: share for looked in views_read.values() for file, share in looked.shares.items()},
        thumbnails=tuple(thumbnails),
        merged=any(len(groups[chosen[index]]) > 1 for index in views_read),
        views=len(views_read),
        of_views=len(views),
        unreadable=tuple(file for index in sorted(views_read) for file in views_read[index].unreadable),
    )


@dataclass(frozen=True)
class _Looked:
    """Read view: a picture as a data URI, empty if no file of it could be read; shares by file."""

    uri: str
    shares: dict[str, tuple[float, float]]
    unreadable: tuple[str, ...]


def _look(session: Session, shots: Sequence[ShotRecord]) -> _Looked:
    previews, unreadable = [], []
    for shot in shots:
        try:
            previews.append((shot, read_preview(session, shot)))
        except RigError:
            unreadable.append(shot.file)
    uri = ""
    if previews:
        uri = jpeg_uri(upright(_thumbnail(previews), previews[0][1].orientation), 80)
    shares = {shot.file: (preview.clipped, preview.dark) for shot, preview in previews}
    return _Looked(uri, shares, tuple(unreadable))


def read_preview(session: Session, shot: ShotRecord) -> ShotPreview:
    """Read one shot's file for the page."""
    path, kind = session.file(shot), session.camera(shot.camera).kind
    if kind == "raw":
        raw = read_raw(path)
        signal, clipped = raw.signal(), raw.saturated()
        rgb = balanced(cell_means(signal, raw.cfa), raw.neutral)
        valid = cell_means(clipped, raw.cfa).max(-1) == 0
        dark = float((signal < DARK).mean())
        return ShotPreview(
            float(clipped.mean()), dark, *_reduced(rgb, valid), orientation=raw.metadata.orientation
        )
    if kind == "hdr":
        rgb = read_light(path)
        return ShotPreview(0.0, 0.0, *_reduced(rgb, np.ones(rgb.shape[:2], bool)))
    photo = read_photo(path)
    top = 2**photo.bit_depth - 1
    levels = np.linspace(0.0, 1.0, top + 1)
    light = srgb_decode(levels).astype(np.float32)
    height, width = photo.pixels.shape[:2]
    factor = _factor(height, width)
    counts, parts = np.zeros(top + 1, np.int64), []
    # Band by band: the light of all samples takes several times the memory of their codes.
    rows = factor * max(1, BAND // factor)
    for first in range(0, height, rows):
        codes = np.rint(photo.pixels[first : first + rows] * np.float32(top)).astype(np.uint16)
        counts += np.bincount(codes.ravel(), minlength=top + 1)
        if len(codes) >= factor:
            parts.append(_reduced(light[codes], codes <= CLIPPED * top, factor))
    rgb, valid = (np.concatenate(sides) for sides in zip(*parts, strict=True))
    shares = counts / photo.pixels.size
    clipped, dark = shares[levels > CLIPPED].sum(), shares[levels < DARK].sum()
    held = photo.metadata.orientation
    return ShotPreview(float(clipped), float(dark), rgb, valid, developed=True, orientation=held)


def _factor(height: int, width: int) -> int:
    """Pixels of a file, on a side, that are one of the picture in the page."""
    return max(1, min(width // THUMBNAIL_WIDTH, height))


def _reduced(rgb: Array32, valid: Mask, factor: int | None = None) -> tuple[Array32, Mask]:
    """Averaged to about the width of a thumbnail; a pixel is valid if all it was made of is.

    valid: [H, W], or [H, W, 3] by sample. factor: as `_factor` has it of the whole picture.
    """
    factor = factor or _factor(*rgb.shape[:2])
    height, width = rgb.shape[0] // factor, rgb.shape[1] // factor

    def averaged(picture: Array32) -> Array32:
        cut = picture[: height * factor, : width * factor]
        return np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA), np.float32)

    trusted = averaged((~valid).astype(np.float32)) == 0
    return averaged(rgb), np.asarray(trusted.all(-1) if trusted.ndim == 3 else trusted, np.bool_)


def _thumbnail(previews: Sequence[tuple[ShotRecord, ShotPreview]]) -> Bytes:
    """A view as one picture: a single photograph as it is, else its bracket merged."""
    if len(previews) == 1 and previews[0][1].developed:
        return fitted(developed(previews[0][1].rgb, 0.0), THUMBNAIL_WIDTH)
    return _merged(previews)


def _merged(previews: Sequence[tuple[ShotRecord, ShotPreview]]) -> Bytes:
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


def compressed(radiance: Floats) -> Bytes:
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
