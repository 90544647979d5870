"""What is taken from the images of one view, so that no more than one view's images are held at a time."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import compress

import cv2
import numpy as np
import numpy.typing as npt

from calib.data.features import Features, extract, unmasked
from calib.data.previews import is_faint, preview
from calib.data.views import View, read_view
from calib.light.tracks import brightness_at, colour_at, light
from imaging.files.photo import encode_png
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.linear_frame import LinearFrame
from imaging.merge.masks import mask_of, masked
from imaging.mosaic import Matrix
from imaging.session.calibration import Response
from imaging.session.session import Session

BLANK_SHARE = 0.95
"""Of an image that is black or saturated, above which the view shows nothing."""
LEAST_SNR = 3.0
LIT_SNR, LIT_SHARE = 5.0, 1e-5
"""A frame is lit if more than this share of it is so far above its noise; by noise alone it is a thirtieth of
that."""
LIT_REACH = 5
"""px: what is lit has company in a square so wide, as the image of any light has, and a hot photosite has
not. In it a mosaic has every colour several times."""


@dataclass(frozen=True, eq=False)
class ViewSummary:
    """What is kept of the images of one view.

    png: the feature picture, 8 bits; width, height: its size. brightness: float64 [K], natural log of
    the luminance around each feature, NaN where it is not known well; colour: float64 [K, 3], the same of
    camera RGB. blank: why the view shows
    nothing, 'black' or 'saturated'; None if it shows something. faint: whether most of it is noise.
    """

    png: bytes
    width: int
    height: int
    features: Features
    brightness: npt.NDArray[np.float64]
    colour: npt.NDArray[np.float64]
    blank: str | None
    faint: bool


def summarise(
    session: Session,
    view: View,
    scale: Mapping[str, float],
    response: Response,
    camera_from_rec709: Matrix | None,
    threads: int,
) -> ViewSummary:
    """Merge the exposures of a view, find its features and how bright the scene is around them.

    Features are found in the whole picture, since the border of a mask would look like a thing of the
    scene; those behind a mask are dropped then. No brightness is told from behind a mask.
    """
    frames = read_view(session, view, scale, response)
    lit = [_is_lit(frame) for frame in frames]
    if not any(lit):
        lit = [True] * len(frames)
    merged = merge_bracket(list(compress(frames, lit)))
    picture = preview(merged)
    if any(shot.mask is not None for shot in view.shots):
        merged = merge_bracket(list(compress(masked(session, view.shots, frames), lit)))
    height, width = picture.shape
    blank = _blank(merged)
    found = _unmasked(session, view, extract(picture, threads), width, height)
    seen = light(merged, None if camera_from_rec709 is None else np.array(camera_from_rec709))
    return ViewSummary(
        png=encode_png(np.rint(255.0 * picture).astype(np.uint8)),
        width=width,
        height=height,
        features=found,
        brightness=brightness_at(seen, found.points, width, height),
        colour=colour_at(seen, found.points, width, height),
        blank=blank,
        faint=is_faint(merged),
    )


def _is_lit(frame: LinearFrame) -> bool:
    """Whether a frame holds more than noise; one that does not would only spoil what longer ones saturate."""
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


def _unmasked(session: Session, view: View, found: Features, width: int, height: int) -> Features:
    """The features that no mask of the view's shots covers; width, height: of the picture they are in, px."""
    for shot in view.shots:
        counts = mask_of(session, shot, shot.height, shot.width)
        if counts is not None:
            found = unmasked(found, counts, width, height)
    return found


def _blank(merged: Merged) -> str | None:
    """Why a view shows nothing, of its pixels that hold a number and that no mask hides."""
    seen = np.isfinite(merged.radiance)
    fewest = BLANK_SHARE * seen.sum()
    if merged.clipped.sum() > fewest:
        return "saturated"
    if merged.dark.sum() > fewest:
        return "black"
    if merged.sigma is not None:
        dim = merged.valid & (merged.radiance < LEAST_SNR * merged.sigma)
        if (dim | merged.dark).sum() > fewest:
            return "black"
    return None
