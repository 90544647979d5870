"""Options that a user gives a node, in a module that imports nothing heavy."""

from dataclasses import dataclass
from typing import Annotated

from imaging.request import Request


@dataclass(frozen=True)
class NodeRequest(Request):
    """Options of a node beside its name, its folder and its cameras on the network."""

    sim: Annotated[str | None, "Serve simulated cameras, those of this rig, instead of the USB."] = None
    profile: Annotated[
        str,
        "With --sim, the cameras: generic, canon-eos-6d, canon-eos-r7, nikon-z6, sony-a7m4 or usb3-vision.",
    ] = "generic"
    seed: Annotated[int, "The same seed gives the same bytes."] = 0
    rough: Annotated[bool, "With --sim: inject bus errors into 5 % of camera requests."] = False
