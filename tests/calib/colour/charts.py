"""Photographs of a colour chart, made from spectra: what a test or a measurement knows the truth of."""

from dataclasses import dataclass
from functools import cache

import colour
import cv2
import numpy as np

from imaging.arrays import Array, Array32, Floats
from imaging.colour.spaces import PRIMARIES, REC709_FROM_XYZ, adaptation
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import FrameMetadata, Matrix, RawMosaic

CAMERAS = {"nikon": "Nikon 5100 (NPL)", "sigma": "Sigma SDMerill (NPL)"}
BLACK, WHITE = 512, 15871
FULL_WELL = 40_000.0
"""Electrons at white."""
READ = 4.0
"""Electrons of read noise."""


@dataclass(frozen=True, eq=False)
class World:
    """The chart in a light: camera RGB of its patches and linear Rec.709 as an observer adapted to the light
    sees them, both float64 [24, 3] and of a perfect diffuser 1 in green; and the camera's white [3]."""

    camera: Array
    truth: Array
    white: Array


@cache
def world(camera: str, illuminant: str) -> World:
    """Patches by Ohta's reflectances, the camera by NPL's sensitivities, light by CIE's tables."""
    shape = colour.SpectralShape(400, 700, 10)
    sensitivity = colour.MSDS_CAMERA_SENSITIVITIES[CAMERAS[camera]].copy().align(shape).values
    light = colour.SDS_ILLUMINANTS[illuminant].copy().align(shape).values
    patches = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"].values()
    reflectance = np.array([patch.copy().align(shape).values for patch in patches])
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape).values
    white = light @ observer
    xyz = (reflectance * light) @ observer / white[1]
    adapted = REC709_FROM_XYZ @ adaptation(tuple(white[:2] / white.sum()), PRIMARIES["rec709"][3])
    neutral = light @ sensitivity
    return World((reflectance * light) @ sensitivity / neutral[1], xyz @ adapted.T, neutral / neutral[1])


def square_on(width: int, height: int, share: float = 0.5, turn: float = 0.0, tilt: float = 0.0) -> Array:
    """Corners [4, 2] of a chart that takes this share of the width; turn: degrees; tilt: 0 (frontal) to 1.

    From the corner of the first patch, clockwise.
    """
    angle = np.radians(turn)
    across = np.array((np.cos(angle), np.sin(angle))) * share * width / 2
    down = np.array((-np.sin(angle), np.cos(angle))) * share * width / 3
    centre = np.array((width / 2, height / 2))
    far = 1 - 0.4 * tilt  # the right side is farther away
    return np.array(
        [
            centre - across - down,
            centre + across * far - down * far,
            centre + across * far + down * far,
            centre - across + down,
        ]
    )


def painted(patches: Array, background: Array, corners: Array, width: int, height: int) -> Array32:
    """A chart on a wall: light float32 [height, width, 3], patches [24, 3] inside a dark frame."""
    cell, gap = 40, 6
    card = np.full((4 * (cell + gap) + gap, 6 * (cell + gap) + gap, 3), 0.035 * background, np.float32)
    for index, patch in enumerate(patches):
        row, column = divmod(index, 6)
        top, left = gap + row * (cell + gap), gap + column * (cell + gap)
        card[top : top + cell, left : left + cell] = patch
    rows, columns = card.shape[:2]
    source = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32) - 0.5
    fine = 3  # oversampled, so that edges are no stairs
    target = (corners * fine - 0.5).astype(np.float32)
    to_image = cv2.getPerspectiveTransform(source, target)
    canvas = np.empty((height * fine, width * fine, 3), np.float32)
    canvas[:] = 0.45 * background
    cv2.warpPerspective(
        card, to_image, (width * fine, height * fine), canvas, cv2.INTER_AREA, cv2.BORDER_TRANSPARENT
    )
    return cv2.resize(canvas, (width, height), interpolation=cv2.INTER_AREA)


def photograph(
    light: Floats,
    exposure: float,
    *,
    seed: int = 0,
    vignetting: float = 0.0,
    noisy: bool = True,
    cfa: Cfa = Cfa.RGGB,
    camera_from_xyz: Matrix | None = None,
    time: float = 1.0,
) -> RawMosaic:
    """Response of a sensor to camera RGB [H, W, 3]; light times `exposure` is the signal, 1 at white."""
    height, width = light.shape[:2]
    y, x = np.mgrid[0:height, 0:width] + 0.5
    square = ((x - width / 2) ** 2 + (y - height / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
    signal = mosaic(light * (1 + vignetting * square)[..., None], cfa) * exposure
    random = np.random.default_rng(seed)
    electrons = np.maximum(signal, 0) * FULL_WELL
    if noisy:
        electrons = np.minimum(random.poisson(electrons), FULL_WELL) + random.normal(0, READ, electrons.shape)
    counts = BLACK + electrons / FULL_WELL * (WHITE - BLACK)
    return RawMosaic(
        np.clip(np.rint(counts), 0, WHITE).astype(np.uint16),
        cfa,
        ((BLACK,),),
        WHITE,
        camera_from_xyz=camera_from_xyz,
        noise_profile=(1 / FULL_WELL, (READ / FULL_WELL) ** 2),
        metadata=FrameMetadata(
            make="Maker", model="One", exposure=Exposure(time=time, f_number=1.0, iso=100.0)
        ),
    )
