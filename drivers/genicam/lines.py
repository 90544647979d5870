"""Trigger source, software or the rising edge of an input; and the output that a leader raises.

Names of the Standard Features Naming Convention. The trigger is off while its source is changed, as Spinnaker
demands; a Blackfly S drops pulses during readout unless TriggerOverlap is ReadOut. ExposureActive is a line
source of Basler's (docs.baslerweb.com/line-source) and FLIR's cameras. An output of the open-collector kind,
such as Line1 of a Blackfly S, needs a pull-up resistor in the cable. Verified against the simulator.
"""

from dataclasses import dataclass

from drivers.errors import CameraRefused
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.settings import set_if_there

_SOFTWARE = "Software"
_PULSES = ("Line", "Action")
"""Sources whose pulses come from outside: lines, and the action commands of GigE Vision."""


@dataclass(frozen=True)
class Wiring:
    """Lines by the camera's names, or None: the input that triggers it, the output that it drives."""

    listens_to: str | None = None
    drives: str | None = None


def apply(nodes: NodeMap, name: str, wiring: Wiring) -> None:
    """Set trigger and lines up, whatever was set before. CameraRefused if it has not those lines.

    name: of the camera, for messages.
    """
    _disable(nodes)
    if wiring.listens_to is None:
        enable(nodes, _SOFTWARE)
    else:
        _listen(nodes, name, wiring.listens_to)
    if wiring.drives is not None:
        if wiring.drives == wiring.listens_to:
            raise CameraRefused(f"{name} listens to {wiring.drives}: have it drive another line.")
        _drive(nodes, name, wiring.drives)


def _listen(nodes: NodeMap, name: str, line: str) -> None:
    """Start each frame at the rising edge of an input line."""
    offered = tuple(source for source in nodes.entries("TriggerSource") if source.startswith(_PULSES))
    if line not in offered:
        raise CameraRefused(f"{name} cannot be triggered by {line}: {_choice(offered)}.")
    if line in nodes.entries("LineSelector"):
        nodes.set("LineSelector", line)
        set_if_there(nodes, "LineMode", "Input")
        if nodes.available("LineMode") and nodes.text("LineMode") != "Input":
            others = tuple(other for other in offered if other != line)
            raise CameraRefused(f"{name} has {line} as an output only: {_choice(others)}.")
    enable(nodes, line)


def _drive(nodes: NodeMap, name: str, line: str) -> None:
    """Raise an output line while the sensor is exposed."""
    lines = nodes.entries("LineSelector")
    if line in lines:
        nodes.set("LineSelector", line)
        set_if_there(nodes, "LineMode", "Output")
        is_output = not nodes.available("LineMode") or nodes.text("LineMode") == "Output"
        if is_output and set_if_there(nodes, "LineSource", "ExposureActive"):
            return
    others = tuple(other for other in lines if other != line)
    raise CameraRefused(f"{name} cannot show on {line} that it exposes: {_choice(others)}.")


def _choice(lines: tuple[str, ...]) -> str:
    return f"choose among its lines {', '.join(lines)}" if lines else "it has no other line for that"


def _disable(nodes: NodeMap) -> None:
    """Switch every trigger off, and choose that of single frames."""
    for trigger in nodes.entries("TriggerSelector"):
        nodes.set("TriggerSelector", trigger)
        nodes.set("TriggerMode", "Off")
    set_if_there(nodes, "TriggerSelector", "FrameStart")
    nodes.set("TriggerMode", "Off")


def enable(nodes: NodeMap, source: str) -> None:
    """Select `source` for the current trigger, which is off; some cameras list sources only while it is
    on.
    """
    chosen = set_if_there(nodes, "TriggerSource", source)
    set_if_there(nodes, "TriggerActivation", "RisingEdge")
    set_if_there(nodes, "TriggerOverlap", "ReadOut")
    if nodes.writable("TriggerDelay"):
        nodes.set_nearest("TriggerDelay", 0.0)
    nodes.set("TriggerMode", "On")
    if not chosen:
        nodes.set("TriggerSource", source)
