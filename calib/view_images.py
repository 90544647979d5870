"""Features of the views, and the brightness of the scene around them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import cast

import cv2
import numpy as np

from calib.data.features import FeatureKind, Features, find, unmasked
from calib.data.previews import is_faint, preview
from calib.data.unfinished import Arrays, Unfinished
from calib.data.views import View, of_one_band, read_view
from calib.evidence import Evidence
from calib.light.tracks import brightness_at, colour_at, light
from imaging.arrays import Array
from imaging.compute import memory
from imaging.compute.cores import available_cores
from imaging.compute.processes import in_processes
from imaging.files.photo import encode_png
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.linear_frame import LinearFrame
from imaging.merge.masks import mask_of, masked
from imaging.progress import Progress
from imaging.sensor.mosaic import Matrix
from imaging.session.calibration import Response
from imaging.session.session import Session
from imaging.session.view_id import ViewId

BLANK_SHARE = 0.95
"""Share of black or saturated pixels above which the view shows nothing."""
LEAST_SNR = 3.0
LIT_SNR, LIT_SHARE = 5.0, 1e-5
"""A frame is lit if more than this share of it is so far above its noise; by noise alone it is a thirtieth of
that."""
LIT_REACH = 5
"""px: what is lit has company in a square so wide, as the image of any light has, and a hot photosite has
not. In it a mosaic has every colour several times."""
WORTHWHILE = 50e6
"""Samples of all images above which other processes are begun: each takes some two seconds to begin, in which
it would be through ten million."""
PER_SAMPLE = 40
"""Bytes that looking at a view takes for each sample of its images: 21 of a JPEG, 34 of a RAW bracket
were measured."""
PER_PROCESS = 400_000_000
"""Bytes of a process besides: of its libraries and its compiled kernels; 240 million were measured."""
ROOM = 0.5
"""Share of the free memory that all processes together may take."""


@dataclass(frozen=True, eq=False)
class ViewSummary:
    """Summary of the images of one view.

    png: the feature picture, 8 bits; width, height: its size. brightness: float64 [K], natural log of
    the luminance around each feature, NaN where it is not known well; colour: float64 [K, 3], the same of
    camera RGB. blank: why the view shows
    nothing, 'black' or 'saturated'; None if it shows something. faint: whether most of it is noise.
    """

    png: bytes
    width: int
    height: int
    features: Features
    brightness: Array
    colour: Array
    blank: str | None
    faint: bool

    def arrays(self) -> Arrays:
        """All of it, as files keep it; `of` is the inverse."""
        return {
            "png": np.frombuffer(self.png, np.uint8),
            "size": np.array([self.width, self.height]),
            "points": self.features.points,
            "descriptors": self.features.descriptors,
            "kind": np.array(self.features.kind),
            "brightness": self.brightness,
            "colour": self.colour,
            "blank": np.array(self.blank or ""),
            "faint": np.array(self.faint),
        }

    @classmethod
    def of(cls, arrays: Arrays) -> "ViewSummary":
        """Return what `arrays` made."""
        width, height = (int(side) for side in arrays["size"])
        kind = cast(FeatureKind, str(arrays["kind"]))
        features = Features(arrays["points"], arrays["descriptors"], kind)
        blank = str(arrays["blank"]) or None
        return cls(
            arrays["png"].tobytes(), width, height, features, arrays["brightness"], arrays["colour"],
            blank, bool(arrays["faint"]),
        )  # fmt: skip


def summaries(
    evidence: Evidence, unfinished: Unfinished, progress: Progress, kind: FeatureKind = "sift"
) -> dict[ViewId, ViewSummary]:
    """Summarise the images of every view, several at a time, as cores and memory allow.

    Args:
        evidence: Views, and what their images are read with.
        unfinished: Store of what an interrupted run has found, which is not looked for again.
        progress: Callback for the current step, the steps done, and all of them.
        kind: Features to look for.
    """
    every = {view.id: unfinished.large(f"{kind} {view.id}") for view in evidence.views}
    missing = [view for view in evidence.views if every[view.id] is None]
    known = len(every) - len(missing)
    computed = in_processes(
        processes(missing),
        summarise,
        [
            (
                evidence.session,
                view,
                {shot.file: evidence.light.scale[shot.file] for shot in view.shots},
                evidence.light.responses[view.camera.name],
                evidence.sensors[view.camera.name].camera_from_rec709,
                kind,
            )
            for view in missing
        ],
    )
    step = "finding features" if kind == "sift" else f"finding {kind} features"
    progress(step, known, len(every))
    for done, (view, summary) in enumerate(zip(missing, computed, strict=True), known + 1):
        every[view.id] = arrays = summary.arrays()
        unfinished.keep_large(f"{kind} {view.id}", arrays)
        progress(step, done, len(every))
    return {view: ViewSummary.of(arrays) for view, arrays in every.items() if arrays is not None}


def processes(views: Sequence[View]) -> int:
    """Return how many processes are to look at views at a time; 1: this one."""
    samples = [
        sum(shot.width * shot.height * (1 if view.camera.kind == "raw" else 3) for shot in view.shots)
        for view in views
    ]
    if sum(samples) < WORTHWHILE:
        return 1
    fit = ROOM * memory.available() / (PER_PROCESS + PER_SAMPLE * max(samples))
    return max(min(available_cores(), len(views), int(fit)), 1)


def summarise(
    session: Session,
    view: View,
    scale: Mapping[str, float],
    response: Response,
    camera_from_rec709: Matrix | None,
    kind: FeatureKind = "sift",
) -> ViewSummary:
    """Merge the exposures of a view, find its features and the brightness of the scene around them.

    Features are found in the whole picture, since the border of a mask would look like a thing of the
    scene; those behind a mask are dropped then. No brightness is measured behind a mask.

    Args:
        session: Session of the view.
        view: View, with its shots.
        scale: Exposure scale of each shot's file, s.
        response: Response of the camera, which only developed photographs need.
        camera_from_rec709: Colour matrix of the camera, a row for each channel; None if it is not known.
        kind: Features to look for.

    Returns:
        The summary of its images.

    Raises:
        InputError: A file or a mask is missing or damaged.
    """
    parts = of_one_band([view])
    bands = [_merged(session, part, scale, response, hidden=False) for part in parts]
    picture = preview(mean_of_bands(bands, alike=True))
    if any(shot.mask is not None for shot in view.shots):
        bands = [_merged(session, part, scale, response, hidden=True) for part in parts]
    merged = mean_of_bands(bands)
    height, width = picture.shape
    blank = _blank(merged)
    features = _unmasked(session, view, find(picture, kind), width, height)
    brightness = light(merged, None if camera_from_rec709 is None else np.array(camera_from_rec709))
    return ViewSummary(
        png=encode_png(np.rint(255.0 * picture).astype(np.uint8)),
        width=width,
        height=height,
        features=features,
        brightness=brightness_at(brightness, features.points, width, height),
        colour=colour_at(brightness, features.points, width, height),
        blank=blank,
        faint=is_faint(merged),
    )


def _merged(
    session: Session, view: View, scale: Mapping[str, float], response: Response, *, hidden: bool
) -> Merged:
    """The bracket of a view through one filter; hidden: without what is behind a mask."""
    frames = read_view(session, view, scale, response)
    # A single frame is taken as it is.
    lit = [len(frames) > 1 and _is_lit(frame) for frame in frames]
    if not any(lit):
        lit = [True] * len(frames)
    return merge_bracket(list(compress(masked(session, view.shots, frames) if hidden else frames, lit)))


def mean_of_bands(merged: Sequence[Merged], *, alike: bool = False) -> Merged:
    """One picture of a view through several filters, whose pixels lie on each other.

    alike: each band counts by its own median, so that features are found in all; else light is added up as it
    is, as comparable from view to view as that of each band.
    """
    if len(merged) == 1:
        return merged[0]
    weights = [1.0 / (_median(one) if alike else 1.0) / len(merged) for one in merged]
    sigma = None
    if all(one.sigma is not None for one in merged):
        parts = [
            weight * one.sigma for weight, one in zip(weights, merged, strict=True) if one.sigma is not None
        ]
        sigma = np.sqrt(np.sum(np.square(parts), axis=0)).astype(np.float32)
    clipped, dark = (
        np.logical_or.reduce([getattr(one, name) for one in merged]) for name in ("clipped", "dark")
    )
    return Merged(
        radiance=np.sum([w * one.radiance for w, one in zip(weights, merged, strict=True)], axis=0).astype(
            np.float32
        ),
        sigma=sigma,
        valid=np.logical_and.reduce([one.valid for one in merged]),
        clipped=clipped,
        dark=dark & ~clipped,
        cfa=merged[0].cfa,
    )


def _median(merged: Merged) -> float:
    """Median of the known pixels of a picture, at least tiny."""
    known = merged.radiance[merged.valid]
    return max(float(np.median(known)), 1e-12) if known.size else 1.0


def _is_lit(frame: LinearFrame) -> bool:
    """Return whether a frame holds more than noise; otherwise it would only spoil what longer ones
    saturate.
    """
    if frame.noise is None:
        return True
    alone = merge_bracket([frame])
    assert alone.sigma is not None
    above = frame.saturated | (alone.valid & (alone.radiance > LIT_SNR * alone.sigma))
    square = (LIT_REACH, LIT_REACH)
    company = cv2.boxFilter(
        above.astype(np.uint8), -1, square, normalize=False, borderType=cv2.BORDER_CONSTANT
    )
    return bool((above & (company > 1)).mean() > LIT_SHARE)


def _unmasked(session: Session, view: View, features: Features, width: int, height: int) -> Features:
    """The features that no mask of the view's shots covers; width, height: of the picture they are in, px."""
    for shot in view.shots:
        counts = mask_of(session, shot, shot.height, shot.width)
        if counts is not None:
            features = unmasked(features, counts, width, height)
    return features


def _blank(merged: Merged) -> str | None:
    """Return why a view shows nothing, of its pixels that hold a number and that no mask hides."""
    visible = np.isfinite(merged.radiance)
    fewest = BLANK_SHARE * visible.sum()
    if merged.clipped.sum() > fewest:
        return "saturated"
    if merged.dark.sum() > fewest:
        return "black"
    if merged.sigma is not None:
        dim = merged.valid & (merged.radiance < LEAST_SNR * merged.sigma)
        if (dim | merged.dark).sum() > fewest:
            return "black"
    return None
