"""Parts of the light that scene points determine, each of which can be left out."""

from typing import Literal

LightPart = Literal["exposure", "white_balance", "falloff", "gain"]
"""exposure: of each photograph, beside its label; white_balance: of each photograph, and between the cameras
of a rig; falloff: towards the corners; gain: sensitivities of the cameras."""
ASKED = "left out, as was asked"
