"""Colour spaces of files of linear light, by their common names."""

from typing import Literal

Space = Literal["rec709", "acescg", "aces2065-1"]
SPACE_PRIMARIES: dict[Space, str] = {"rec709": "rec709", "acescg": "ap1", "aces2065-1": "ap0"}
SPACE_NAMES: dict[Space, str] = {"rec709": "Rec.709", "acescg": "ACEScg", "aces2065-1": "ACES2065-1"}
