"""What rig sets on a machine vision camera, in the names of the Standard Features Naming Convention.

Gain in dB is mapped to ISO by `ISO = 100 * 10 ** (dB / 20)`: 0 dB is ISO 100. That is arithmetic, so that
exposures scale as the signal does; it is not the speed of the sensor by ISO 12232.
"""

import math

import numpy as np

from drivers.camera import Capabilities
from drivers.errors import CameraRefused
from drivers.genicam.nodemap import Limits, NodeMap
from drivers.genicam.pixels import BY_NAME, PixelFormat, format_of
from imaging.cfa import Tile, as_tile
from imaging.exposure import Exposure

_PACKINGS = {"p": 2, "Packed": 1, "plain": 0}


def iso_of(decibels: float) -> float:
    """The ISO that a gain counts as."""
    return 100.0 * math.pow(10.0, decibels / 20.0)


def decibels_of(iso: float) -> float:
    """The gain that an ISO asks for."""
    return 20.0 * math.log10(iso / 100.0)


def set_if_there(nodes: NodeMap, name: str, value: str | int | float | bool) -> bool:
    """Set a feature that not every camera has; whether this one has it, and the entry."""
    if not nodes.writable(name) or (isinstance(value, str) and value not in nodes.entries(name)):
        return False
    nodes.set(name, value)
    return True


def prepare(nodes: NodeMap, name: str) -> PixelFormat:
    """Stop what runs, leave nothing to automatics and choose the best format, which is returned.

    name: of the camera, for messages. CameraRefused if it has neither a Bayer mosaic nor is mono.
    """
    stop(nodes)
    for automatic in (
        "SequencerMode",
        "SequencerConfigurationMode",
        "ExposureAuto",
        "GainAuto",
        "BalanceWhiteAuto",
    ):
        set_if_there(nodes, automatic, "Off")
    set_if_there(nodes, "ExposureMode", "Timed")
    set_if_there(nodes, "GainSelector", "All")
    if set_if_there(nodes, "ChunkModeActive", True):
        set_if_there(nodes, "ChunkSelector", "ExposureTime")
        set_if_there(nodes, "ChunkEnable", True)
    return _choose_format(nodes, name)


def stop(nodes: NodeMap) -> None:
    """Stop the acquisition, if one runs."""
    if nodes.writable("AcquisitionStop"):
        nodes.execute("AcquisitionStop")


def _choose_format(nodes: NodeMap, name: str) -> PixelFormat:
    """Set the format with most bits a value and, of those, fewest in the payload.

    A camera with a mosaic may offer mono too, which it makes of it.
    """
    offered = nodes.entries("PixelFormat")
    known = [BY_NAME[entry] for entry in offered if entry in BY_NAME]
    if not offered:
        raise CameraRefused(
            f"{name} offers no pixel format: close other programs that use it, and replug it."
        )
    if not known:
        raise CameraRefused(
            f"{name} sends neither a Bayer mosaic nor mono (it offers {', '.join(offered)}): connect a "
            "camera that does in its place."
        )
    best = max(known, key=lambda one: (not one.cfa.mono, one.bits, _PACKINGS[one.packing]))
    nodes.set("PixelFormat", best.name)
    return best


def set_exposure(nodes: NodeMap, exposure: Exposure) -> Exposure:
    """Set the nearest time and, if an ISO is given, gain; returns what the camera reads back.

    The iris is the lens's own affair: f-numbers are not known.
    """
    time = _time_feature(nodes)
    nodes.set(time, _within(nodes.limits(time), 1e6 * exposure.time))
    if exposure.iso is not None and nodes.writable("Gain"):
        nodes.set("Gain", _within(nodes.limits("Gain"), decibels_of(exposure.iso)))
    return read_exposure(nodes)


def read_exposure(nodes: NodeMap) -> Exposure:
    """What the camera is set to."""
    iso = round(iso_of(float(nodes.number("Gain"))), 3) if nodes.available("Gain") else None
    return Exposure(time=float(nodes.number(_time_feature(nodes))) / 1e6, iso=iso)


def read_capabilities(nodes: NodeMap) -> Capabilities:
    """Size and bits as set; times and ISOs as ladders of third stops over what it can be set to."""
    times = nodes.limits(_time_feature(nodes))
    isos: tuple[float, ...] = ()
    if nodes.writable("Gain"):
        gains = nodes.limits("Gain")
        isos = ladder(iso_of(gains.low), iso_of(gains.high), 3)
    white = white_level(nodes, format_of(int(nodes.number("PixelFormat"))))
    return Capabilities(
        width=int(nodes.number("Width")),
        height=int(nodes.number("Height")),
        bit_depth=white.bit_length(),
        times=ladder(max(times.low, 1.0) / 1e6, times.high / 1e6, 3),
        f_numbers=(),
        isos=isos,
    )


def _time_feature(nodes: NodeMap) -> str:
    """ExposureTime, or its name in version 1 of the convention, which older GigE cameras have."""
    names = ("ExposureTime", "ExposureTimeAbs")
    return next((name for name in names if nodes.available(name)), names[0])


def _within(limits: Limits, value: float) -> float:
    return min(max(value, limits.low), limits.high)


def ladder(low: float, high: float, steps: int) -> tuple[float, ...]:
    """Values from `low` to `high`, both included, `steps` to a doubling between."""
    count = math.floor(steps * math.log2(high / low) + 1e-9)
    values = [low * 2.0 ** (index / steps) for index in range(count + 1)]
    return tuple(values) if math.isclose(values[-1], high, rel_tol=1e-6) else (*values, high)


def black_levels(nodes: NodeMap, pixels: PixelFormat) -> Tile:
    """The BlackLevel of the sites of the tile, DN; by colour where the camera has that, 0 if it says none."""
    if not nodes.available("BlackLevel"):
        return ((0.0,),)
    colours = ("Red", "Green", "Blue")
    if (
        not pixels.cfa.mono
        and set(colours) <= set(nodes.entries("BlackLevelSelector"))
        and nodes.writable("BlackLevelSelector")
    ):
        levels = []
        for colour in colours:
            nodes.set("BlackLevelSelector", colour)
            levels.append(float(nodes.number("BlackLevel")))
    else:
        levels = [float(nodes.number("BlackLevel"))] * 3
    return as_tile(np.array(levels)[pixels.cfa.pattern])


def white_level(nodes: NodeMap, pixels: PixelFormat) -> int:
    """The largest value, DN: what the camera says, else what the format can hold."""
    most = (1 << pixels.bits) - 1
    if not nodes.available("PixelDynamicRangeMax"):
        return most
    stated = int(nodes.number("PixelDynamicRangeMax"))
    return stated if 0 < stated <= most else most
