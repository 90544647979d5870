"""Closed vocabularies of files and sessions, in a module that imports nothing heavy."""

from typing import Literal

Space = Literal["rec709", "acescg", "aces2065-1"]
"""Colour space of a file of linear light."""
SPACE_PRIMARIES: dict[Space, str] = {"rec709": "rec709", "acescg": "ap1", "aces2065-1": "ap0"}
SPACE_NAMES: dict[Space, str] = {"rec709": "Rec.709", "acescg": "ACEScg", "aces2065-1": "ACES2065-1"}

ExrStorage = Literal["float", "half", "dwaa"]
"""Storage of light in an EXR: float32 or float16 in ZIP, without loss, or float16 in DWAA, with loss."""

Subject = Literal["scene", "dark", "flat", "board"]
"""Purpose of a shot: scene to reconstruct, or calibration target."""
Compression = Literal["none", "ljpeg"]
"""Compression of RAW files that are written."""
