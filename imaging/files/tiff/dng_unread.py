"""Tags of a DNG that give its samples a meaning that rig does not read: the file is refused by their names.

Adobe DNG specification 1.7. What only corrects a lens (GainMap, FixVignetteRadial, warps) or hides a defect
is not applied and no reason to refuse: falloff and distortion are calibrated on the pixels as stored.
"""

import struct

from imaging.files.tiff.directory import Directory, integers
from imaging.files.tiff.dng_tags import SAMPLE_FORMAT

SUB_TILES, COLORIMETRIC, INTERLACE = 50974, 50879, 34857
OPCODES = {51008: "OpcodeList1", 51009: "OpcodeList2", 51022: "OpcodeList3"}
_BENDING = {
    6: "TrimBounds",
    7: "MapTable",
    8: "MapPolynomial",
    10: "DeltaPerRow",
    11: "DeltaPerColumn",
    12: "ScalePerRow",
    13: "ScalePerColumn",
}
"""Opcodes by which the samples are other light, or of another place, than they are stored as."""
_SIGNED, _FLOAT = 2, 3
_SCENE_REFERRED = 0


def reason(tags: Directory) -> str:
    """The end of the sentence that refuses a DNG, which its path begins; '' for one that is read."""
    formats = set(integers(tags, SAMPLE_FORMAT))
    if _FLOAT in formats:
        return (
            "holds floating-point samples (SampleFormat 3), which rig does not read: give the exposures that "
            "it was merged from, or convert it to whole numbers"
        )
    if _SIGNED in formats:
        return "holds signed samples (SampleFormat 2), which rig does not read: convert it to unsigned ones"
    if any(integers(tags, INTERLACE)):
        return "holds every other row of a picture (Interlace): convert it to one of all its rows"
    if integers(tags, SUB_TILES) not in ((), (1, 1)):
        return (
            "holds its tiles in blocks (SubTileBlockSize), which rig does not read: convert it with Adobe "
            "DNG Converter"
        )
    if (integers(tags, COLORIMETRIC) or (_SCENE_REFERRED,)) != (_SCENE_REFERRED,):
        return (
            "holds a picture made for a display and no light (ColorimetricReference): give the RAW file that "
            "it was made of"
        )
    for tag, name in OPCODES.items():
        value = tags.get(tag)
        bending = _bending(value) if isinstance(value, bytes) else ""
        if bending:
            return (
                f"asks for {bending} in its {name}, which rig does not apply: give the camera's own RAW file"
            )
    return ""


def _bending(opcodes: bytes) -> str:
    """The first opcode of a list that may not be left out; a list that is cut off ends where it is."""
    at = 4
    while at + 16 <= len(opcodes):
        number, _, _, length = struct.unpack(">4I", opcodes[at : at + 16])
        if number in _BENDING:
            return _BENDING[number]
        at += 16 + length
    return ""
