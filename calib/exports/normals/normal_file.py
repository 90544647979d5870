"""The file of `rig normals`: albedo in colour, normals, their standard errors and a mask; and a preview."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from calib.exports.normals.fit import PixelFit
from imaging.arrays import Array32, Bytes, Mask
from imaging.colour.spaces import XYZ_FROM_REC709, srgb_encode
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr.writing import ExrValue, write_exr
from imaging.files.photo import encode_png
from imaging.merge.bracket import Merged
from imaging.merge.ghosts import Deghosted
from imaging.merge.picture import Picture, picture_of
from imaging.sensor.cfa import Cfa
from imaging.session.calibration import CameraCalibration

GREY = 0.18
"""Median luminance of an albedo whose scale is not known."""
SATURATED, LEFT_OUT, UNKNOWN = 1, 2, 4
BITS = (
    "0 all lamps count; 1 some are saturated; 2 some are left out: shadows, highlights, saturated ones; 4 no "
    "normal: too few count, or no matt surface is lit so"
)
_LUMINANCE = XYZ_FROM_REC709[1]


@dataclass(frozen=True)
class Mosaic:
    """Shape and filters of the arrays that were fitted; cfa: None for several channels a pixel."""

    shape: tuple[int, ...]
    cfa: Cfa | None


@dataclass(frozen=True)
class Patch:
    """A neutral patch; area: left, top, width and height, px; reflectance: 0..1."""

    area: tuple[int, int, int, int]
    reflectance: float


@dataclass(frozen=True)
class Written:
    """preview: of the file; known: share of pixels with a normal; error: median of theirs, degrees."""

    preview: Path
    known: float
    error: float


def write_normals(
    out: Path,
    fitted: PixelFit,
    mosaic: Mosaic,
    clipped: Mask,
    camera: CameraCalibration | None,
    patch: Patch | None,
    attributes: Mapping[str, ExrValue],
) -> Written:
    """Write the EXR file, and a PNG beside it.

    InputError where nothing is known, of all pixels or in the patch.

    Args:
        out: Path of the EXR.
        fitted: Fit of every pixel, in rows.
        mosaic: Shape of the rows.
        clipped: Where a lamp saturates every exposure.
        camera: Calibration of the camera, for colour and falloff.
        patch: Of known reflectance; None: the albedo is relative.
        attributes: More of the header.
    """
    height, width = mosaic.shape[:2]
    picture = _albedo(fitted, mosaic, camera)
    assert picture.sigma is not None  # of every fit
    known = fitted.known.reshape(height, width) & np.isfinite(picture.light).all(axis=-1)
    if not known.any():
        raise InputError(
            f"{out} would hold no normal, since the light of three lamps or more is measured nowhere: take "
            "shorter or longer exposures, or correct lamps.json."
        )
    scale = _scale(picture.light, known, patch)
    mask = (
        SATURATED * clipped.reshape(height, width, -1).any(axis=-1)
        + LEFT_OUT * (fitted.lamps.reshape(height, width) < fitted.lamps.max())
        + UNKNOWN * ~known
    )
    normals = np.where(known[..., None], fitted.normal.reshape(height, width, 3), 0.0)
    albedo = np.where(known[..., None], picture.light * scale, 0.0).astype(np.float32)
    sigma = np.where(known[..., None], picture.sigma * scale, np.inf)
    degrees = np.where(known, np.degrees(fitted.error).reshape(height, width), np.inf)
    relative = f"albedo times one factor that is not known: the median is {GREY}"
    write_exr(
        out,
        {letter: albedo[..., index] for index, letter in enumerate("RGB")},
        primaries="rec709" if picture.known_colour else None,
        attributes={
            "rig:units": relative if patch is None else "albedo",
            "rig:axes": "normals: x right, y up, z towards the camera",
            "rig:sigma": "standard errors, that of the normal in degrees; infinite where unknown",
            "rig:mask": BITS,
            "rig:colour": "Rec.709" if picture.known_colour else "camera RGB",
            "software": f"rig {version('hdr-rig')}",
            **attributes,
        },
        data={
            "normal": {f"normal.{axis}": normals[..., index] for index, axis in enumerate("XYZ")},
            "sigma": {
                **{f"sigma.{letter}": sigma[..., index] for index, letter in enumerate("RGB")},
                "sigma.normal": degrees,
            },
            "mask": {"mask": mask.astype(np.float32)},
        },
    )
    preview = out.with_suffix(".png")
    store.write_bytes(preview, encode_png(_preview(normals, albedo, known)))
    return Written(preview, float(known.mean()), float(np.median(degrees[known])))


def _albedo(fitted: PixelFit, mosaic: Mosaic, camera: CameraCalibration | None) -> Picture:
    """The albedo in colour, without falloff of the lens."""
    known = fitted.known.reshape(mosaic.shape[:2] + (1,) * (len(mosaic.shape) - 2))
    light = np.where(known, fitted.albedo.reshape(mosaic.shape), np.nan).astype(np.float32)
    sigma = fitted.albedo_error.reshape(mosaic.shape)
    nowhere = np.zeros(mosaic.shape, bool)
    merged = Merged(light, sigma, np.isfinite(light), nowhere, nowhere, mosaic.cfa)
    return picture_of(Deghosted(merged, nowhere, None, 1.0), mosaic.cfa, camera)


def _scale(light: Array32, known: Mask, patch: Patch | None) -> Array32:
    """Factors on R, G and B that make light an albedo."""
    if patch is None:
        return np.full(3, GREY / np.median(light[known] @ _LUMINANCE), np.float32)
    x, y, width, height = patch.area
    at = np.s_[max(y, 0) : y + height, max(x, 0) : x + width]
    inside = light[at][known[at]]
    if not len(inside) or not (np.median(inside, axis=0) > 0).all():
        raise InputError(
            f"no albedo is measured in the patch {x},{y},{width},{height}: name an area of the picture (of "
            "RAW, of its mosaic) that is neither black nor saturated."
        )
    return (patch.reflectance / np.median(inside, axis=0)).astype(np.float32)


def _preview(normals: Array32, albedo: Array32, known: Mask) -> Bytes:
    """Normals in the usual colours, and beside them the albedo, uint8 [H, 2 W, 3]; black where unknown."""
    coded = np.where(known[..., None], 0.5 + 0.5 * normals, 0.0)
    shown = srgb_encode(np.clip(albedo, 0.0, 1.0))
    return np.asarray(np.rint(255.0 * np.concatenate([coded, shown], axis=1)), np.uint8)
