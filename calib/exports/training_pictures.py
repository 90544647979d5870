"""The pictures that other programs train on: every view in colour, display-referred, all of one exposure.

They have the pixels of the pictures that features are found in, to which the lenses of the COLMAP model
and of transforms.json belong; light that is brighter than white is clipped.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from scipy import ndimage

from calib.data.views import View, read_view
from imaging.arrays import Array, Bytes
from imaging.colour.spaces import balanced, of_channels, rec709_from_camera, srgb_encode
from imaging.demosaicking.demosaic import demosaic
from imaging.merge.bracket import merge_bracket
from imaging.session.calibration import Response
from imaging.session.session import Session

GREY = 0.18
"""Linear level of a session's typical feature, relative to white."""


def exposure(brightness: Mapping[Any, Array]) -> float:
    """The factor from radiance to display light that all pictures of a session share.

    brightness: natural log of the luminance around the features of each view, NaN where it is not known.
    """
    every = np.concatenate([np.zeros(0), *brightness.values()])
    known = every[np.isfinite(every)]
    return GREY / float(np.exp(np.median(known))) if len(known) else 1.0


def picture(
    session: Session,
    view: View,
    scale: Mapping[str, float],
    response: Response,
    camera_from_rec709: tuple[tuple[float, float, float], ...] | None,
    size: tuple[int, int],
    factor: float,
) -> Bytes:
    """A view as sRGB codes, all light brighter than white clipped.

    RAW of a camera whose colour is not known stays camera RGB.

    Args:
        session: Session of the view.
        view: View to draw.
        scale: Exposure scale of each shot's file, s.
        response: Response of the camera, which only developed photographs need.
        camera_from_rec709: Colour matrix of the camera, a row for each channel; None if it is not known.
        size: Width and height of the result, px.
        factor: Factor from radiance to display light (`exposure`).

    Returns:
        Codes, uint8 [h, w, 3].

    Raises:
        InputError: A file is missing or damaged.
    """
    merged = merge_bracket(read_view(session, view, scale, response))
    light = np.array(merged.radiance, np.float32)
    cv2.patchNaNs(light.reshape(len(light), -1), 0.0)
    if merged.cfa is not None:
        light = demosaic(light, merged.cfa, np.asarray(np.isfinite(merged.radiance)), merged.sigma).rgb
    light = cv2.resize(light.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    light = light.reshape(*light.shape[:2], -1)  # which the resizing takes from a single channel
    if camera_from_rec709 is not None:
        light = light @ rec709_from_camera(of_channels(camera_from_rec709, light.shape[2])).T.astype(
            np.float32
        )
    elif merged.cfa is not None:
        light = balanced(light, None)
    if merged.cfa is not None:  # channels that saturate at different light would tint the lamps
        clipped = ndimage.binary_dilation(merged.clipped, np.ones((3, 3), bool)).astype(np.float32)
        white = cv2.resize(clipped, size, interpolation=cv2.INTER_AREA) > 0
        light[white] = light[white].max(axis=-1, keepdims=True)
    return np.asarray(np.rint(255.0 * srgb_encode(factor * light)), np.uint8)


@dataclass
class PointColours:
    """Colours of the points of a COLMAP model: sums of codes, and their number, by point."""

    model: Any
    sums: dict[int, Array] = field(default_factory=dict)

    def add(self, name: str, shown: Bytes) -> None:
        """Add the points' colours in the model's image of this name."""
        height, width = shown.shape[:2]
        image = self.model.find_image_with_name(name)
        for observation in image.points2D if image is not None else ():
            if observation.has_point3D():
                x, y = np.ravel(observation.xy).astype(int)
                code = shown[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]
                self.sums.setdefault(observation.point3D_id, np.zeros(4))[:] += (*code, 1)

    def apply(self) -> None:
        """Give every point that was seen its mean colour."""
        for number, total in self.sums.items():
            self.model.points3D[number].color = np.rint(total[:3] / total[3]).astype(np.uint8)
