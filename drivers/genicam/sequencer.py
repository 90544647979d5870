"""Brackets by the camera itself: its sequencer changes exposure from frame to frame, on one trigger."""

from collections.abc import Sequence

from drivers.errors import CameraRefused
from drivers.genicam import lines, settings
from drivers.genicam.nodemap import NodeMap
from imaging.optics.exposure import Exposure

_NEXT = ("FrameEnd", "FrameStart", "ExposureActive")
"""Triggers that may lead from one set to the next; the first is preferred."""


def can_sequence(nodes: NodeMap) -> bool:
    """Return whether the camera has a sequencer and a trigger for a burst of frames."""
    needed = ("SequencerMode", "SequencerConfigurationMode", "SequencerSetSelector", "SequencerSetSave")
    return (
        all(nodes.available(name) for name in needed)
        and "FrameBurstStart" in nodes.entries("TriggerSelector")
        and nodes.available("AcquisitionBurstFrameCount")
    )


def program(nodes: NodeMap, exposures: Sequence[Exposure]) -> tuple[Exposure, ...]:
    """Store a set for each exposure, one leading to the next, and have a burst run through them.

    Returns what the camera reads back of each. CameraRefused if there are more than it has sets.
    """
    most = int(nodes.limits("SequencerSetSelector").high) + 1
    if len(exposures) > most:
        raise CameraRefused(
            f"a bracket of {len(exposures)} exposures is more than the {most} sets of the camera's "
            "sequencer: shoot fewer."
        )
    nodes.set("SequencerMode", "Off")
    nodes.set("SequencerConfigurationMode", "On")
    source = next(candidate for candidate in _NEXT if candidate in nodes.entries("SequencerTriggerSource"))
    stored = []
    for index, exposure in enumerate(exposures):
        nodes.set("SequencerSetSelector", index)
        stored.append(settings.set_exposure(nodes, exposure))
        settings.set_if_there(nodes, "SequencerPathSelector", 0)
        nodes.set("SequencerTriggerSource", source)
        nodes.set("SequencerSetNext", (index + 1) % len(exposures))
        nodes.execute("SequencerSetSave")
    nodes.set("SequencerSetStart", 0)
    nodes.set("SequencerConfigurationMode", "Off")
    nodes.set("SequencerMode", "On")
    _trigger_burst(nodes, len(exposures))
    return tuple(stored)


def leave(nodes: NodeMap) -> None:
    """Back to single frames, each with its trigger."""
    nodes.set("SequencerMode", "Off")
    source = nodes.text("TriggerSource")
    nodes.set("TriggerMode", "Off")
    nodes.set("TriggerSelector", "FrameStart")
    lines.enable(nodes, source)


def _trigger_burst(nodes: NodeMap, count: int) -> None:
    source = nodes.text("TriggerSource")
    nodes.set("TriggerMode", "Off")
    nodes.set("TriggerSelector", "FrameBurstStart")
    lines.enable(nodes, source)
    nodes.set("AcquisitionBurstFrameCount", count)
    nodes.set("AcquisitionMode", "MultiFrame")
    nodes.set("AcquisitionFrameCount", count)
