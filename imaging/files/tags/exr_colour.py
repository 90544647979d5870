"""Colour encoding of an EXR, from its attributes.

By the recommendation of the ASWF Color Interop Forum, "Identifying the Color Space of OpenEXR Files" (version
1.0.0 of 14 July 2026): the attribute `colorInteropID` names the space, and no `chromaticities` stand beside
it. What is read goes by it too, after the flag of an ACES container (SMPTE ST 2065-4) and before
`chromaticities`, which many programs wrote without knowing.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array
from imaging.colour.spaces import PRIMARIES, REC709_FROM_XYZ, rec709_from_rgb
from imaging.errors import InputError

INTEROP_ID, CHROMATICITIES, ACES_FLAG = "colorInteropID", "chromaticities", "acesImageContainerFlag"
DATA, UNKNOWN = "data", "unknown"
IDS = {
    "rec709": "lin_rec709_scene",
    "rec2020": "lin_rec2020_scene",
    "ap0": "lin_ap0_scene",
    "ap1": "lin_ap1_scene",
}
"""Identifiers of linear light in the primaries of `imaging.colour.spaces.PRIMARIES`."""
_D65 = PRIMARIES["rec709"][3]
_LINEAR: dict[str, tuple[tuple[float, float], ...]] = {
    **{IDS[name]: PRIMARIES[name] for name in IDS},
    "lin_p3d65_scene": ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _D65),
    "lin_adobergb_scene": ((0.640, 0.330), (0.210, 0.710), (0.150, 0.060), _D65),
}
_XYZ = "lin_ciexyzd65_scene"
_TOLERANCE = 1e-3
_ENCODED = ("srgb_", "g18_", "g22_", "g24_", "g26_", "pq_", "hlg_")
"""Beginnings of the forum's names of spaces that are not linear."""


@dataclass(frozen=True)
class ExrColour:
    """matrix: from the R, G, B of a file to linear Rec.709, float64 [3, 3], or None for the identity. doubt:
    a sentence about attributes that contradict each other or say nothing; empty without any.
    """

    matrix: Array | None
    doubt: str = ""


def colour_of(attributes: Mapping[str, object]) -> ExrColour:
    """Read the colour encoding of a file with R, G and B; InputError if these are data, or no linear light.

    Without any the primaries are those of Rec.709, as OpenEXR has it.
    """
    tag = attributes.get(INTEROP_ID)
    name = _resolved(tag) if isinstance(tag, str) else None
    chromaticities = _points(attributes.get(CHROMATICITIES))
    if attributes.get(ACES_FLAG):
        doubt = "" if name in (None, IDS["ap0"]) else f"{INTEROP_ID} {tag} is not that of the ACES container"
        return ExrColour(
            _matrix(PRIMARIES["ap0"]), doubt and f"{doubt} that the file is, whose colours it has."
        )
    if name == DATA:
        raise InputError(
            f"the R, G and B of the EXR are data, not light, as its {INTEROP_ID} says: export the light."
        )
    if name is not None and name.startswith(_ENCODED):
        raise InputError(
            f"the EXR is in {tag}, which is not linear: export it as linear light, such as {IDS['rec709']}."
        )
    if name == _XYZ:
        return ExrColour(np.asarray(REC709_FROM_XYZ, np.float64))
    if name in _LINEAR:
        return ExrColour(_matrix(_LINEAR[name]), _contradiction(name, chromaticities))
    doubt = "" if name in (None, UNKNOWN, "") else f"{INTEROP_ID} {tag} is not known to rig"
    if chromaticities is None:
        return ExrColour(None, doubt and f"{doubt}, so that the light counts as Rec.709.")
    return ExrColour(_matrix(chromaticities), doubt and f"{doubt}, so that the {CHROMATICITIES} count.")


def _resolved(interop_id: str) -> str:
    """An ID without a namespace before a name of the forum, which may be left out."""
    base = interop_id.rpartition(":")[2] if interop_id.count(":") == 1 else interop_id
    return base if base in _LINEAR or base == _XYZ or base.startswith(_ENCODED) else interop_id


def _points(value: object) -> tuple[tuple[float, float], ...] | None:
    if not isinstance(value, tuple) or len(value) != 8:
        return None
    points = tuple(zip(value[::2], value[1::2], strict=True))
    try:
        rec709_from_rgb(points)
    except ValueError:  # nonsense is as good as nothing
        return None
    return points


def _contradiction(name: str, points: tuple[tuple[float, float], ...] | None) -> str:
    if points is None or np.allclose(points, _LINEAR[name], atol=_TOLERANCE):
        return ""
    return f"{CHROMATICITIES} contradict the {INTEROP_ID} {name}, which counts."


def _matrix(points: tuple[tuple[float, float], ...]) -> Array | None:
    if np.allclose(points, PRIMARIES["rec709"], atol=_TOLERANCE):
        return None
    return rec709_from_rgb(points)
