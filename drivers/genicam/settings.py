"""Settings of a machine vision camera, in the names of the Standard Features Naming Convention.

A gain of 1, which is 0 dB, is ISO 100, and the ISO goes with the gain as a factor. That is arithmetic, so
that exposures scale as the signal does; it is not the speed of the sensor by ISO 12232. A gain of unknown
unit has no ISO.
"""

import math

import numpy as np

from drivers.camera import Capabilities
from drivers.errors import CameraRefused
from drivers.genicam import colours, processing, units
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.pixels import BY_NAME, PixelFormat, format_of
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Tile, as_tile

_PACKINGS = {"p": 2, "Packed": 1, "plain": 0}
_SHORTEST, _LONGEST = 1e-6, 3600.0
"""Seconds: the ends of the ladder of a camera that states none."""
_LOWEST_ISO = 1.0


def set_if_there(nodes: NodeMap, name: str, value: str | int | float | bool) -> bool:
    """Set a feature that not every camera has; whether this one has it, and the entry."""
    if not nodes.writable(name) or (isinstance(value, str) and value not in nodes.entries(name)):
        return False
    nodes.set(name, value)
    return True


def prepare(nodes: NodeMap, name: str) -> PixelFormat:
    """Stop what runs, choose the best format, which is returned, and leave values as the sensor gave them.

    name: of the camera, for messages. CameraRefused if it has neither a Bayer mosaic nor is mono, or computes
    something into its frames that cannot be switched off.
    """
    stop(nodes)
    for sequencer in ("SequencerMode", "SequencerConfigurationMode"):
        set_if_there(nodes, sequencer, "Off")
    set_if_there(nodes, "GenDCStreamingMode", "Off")  # its containers are no plain images
    set_if_there(nodes, "ExposureMode", "Timed")
    set_if_there(nodes, "GainSelector", "All")
    best = _choose_format(nodes, name)
    processing.switch_off(nodes, name)
    if not best.cfa.mono:
        colours.even_out(nodes, name)
    return best


def switch_chunks(nodes: NodeMap, on: bool) -> None:
    """Enable the exposure time chunk where the camera has it, and disable all others."""
    wanted = on and "ExposureTime" in nodes.entries("ChunkSelector")
    # In this order: what follows may be locked without.
    steps: tuple[tuple[str, str | bool], ...] = (
        *(("ChunkModeActive", True), ("ChunkSelector", "ExposureTime"), ("ChunkEnable", True)),
    )
    if not (wanted and all(set_if_there(nodes, name, value) for name, value in steps)):
        set_if_there(nodes, "ChunkModeActive", False)


def stop(nodes: NodeMap) -> None:
    """Stop the acquisition, if one runs, and unlock what decides on the size of frames."""
    if nodes.writable("AcquisitionStop"):
        nodes.execute("AcquisitionStop")
    lock(nodes, False)


def lock(nodes: NodeMap, on: bool) -> None:
    """Keep what decides on the size of frames as it is while an acquisition runs, or let go of it."""
    set_if_there(nodes, "TLParamsLocked", int(on))


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

    The iris is the lens's own affair: f-numbers are not known. CameraRefused: an ISO is asked of a camera
    whose gain has no known unit.
    """
    time = time_feature(nodes)
    nodes.set_nearest(time, exposure.time * units.per_second(nodes, time))
    if exposure.iso is not None and nodes.writable("Gain"):
        unit = units.gain_unit(nodes)
        if unit is None:
            stated = nodes.unit("Gain")
            raise CameraRefused(
                f"{nodes.where}: its gain {f'is in {stated!r}' if stated else 'has no unit'}, and may be in "
                "dB or a factor: name no ISO, and set the gain by its maker's program."
            )
        nodes.set_nearest("Gain", units.gain_of(exposure.iso, unit))
    return read_exposure(nodes)


def read_exposure(nodes: NodeMap) -> Exposure:
    """Return what the camera is set to; no ISO where it has no gain, or one whose unit is not known."""
    unit = units.gain_unit(nodes) if nodes.available("Gain") else None
    iso = None if unit is None else round(units.iso_of(float(nodes.number("Gain")), unit), 3)
    time = time_feature(nodes)
    return Exposure(time=float(nodes.number(time)) / units.per_second(nodes, time), iso=iso)


def read_capabilities(nodes: NodeMap) -> Capabilities:
    """Size and bits as set; times and ISOs as ladders of third stops over what it can be set to."""
    isos: tuple[float, ...] = ()
    unit = units.gain_unit(nodes) if nodes.writable("Gain") else None
    if unit is not None and math.isfinite((gains := nodes.limits("Gain")).high - gains.low):
        low = max(units.iso_of(gains.low, unit), _LOWEST_ISO)
        isos = ladder(low, max(units.iso_of(gains.high, unit), low))
    white = white_level(nodes, format_of(int(nodes.number("PixelFormat"))))
    return Capabilities(
        width=int(nodes.number("Width")),
        height=int(nodes.number("Height")),
        bit_depth=white.bit_length(),
        times=_times(nodes),
        f_numbers=(),
        isos=isos,
    )


def _times(nodes: NodeMap) -> tuple[float, ...]:
    """Third stops from the shortest time to the longest, s, each the nearest that the camera takes."""
    name = time_feature(nodes)
    limits, second = nodes.limits(name), units.per_second(nodes, name)
    low = max(limits.low / second, _SHORTEST)
    steps = ladder(low, max(min(limits.high / second, _LONGEST), low))
    return tuple(dict.fromkeys(float(limits.nearest(time * second)) / second for time in steps))


def time_feature(nodes: NodeMap) -> str:
    """ExposureTime, or its name in version 1 of the convention, which older GigE cameras have."""
    names = ("ExposureTime", "ExposureTimeAbs")
    return next((name for name in names if nodes.available(name)), names[0])


def ladder(low: float, high: float) -> tuple[float, ...]:
    """Values from `low` to `high`, both included, three to a doubling between."""
    count = math.floor(3 * math.log2(high / low) + 1e-9)
    values = [low * 2.0 ** (index / 3) for index in range(count + 1)]
    return tuple(values) if math.isclose(values[-1], high, rel_tol=1e-6) else (*values, high)


def black_levels(nodes: NodeMap, pixels: PixelFormat, white: int) -> Tile | None:
    """The BlackLevel of the sites of the tile, DN; by colour where the camera has that.

    white: the largest value, DN. None if it says none, one that no frame can have, or in an unknown unit.
    """
    if not nodes.available("BlackLevel") or (scale := units.black_scale(nodes, white)) is None:
        return None
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
    scaled = scale * np.array(levels)
    return as_tile(scaled[pixels.cfa.pattern]) if 0 <= scaled.min() <= scaled.max() < white else None


def white_level(nodes: NodeMap, pixels: PixelFormat) -> int:
    """The largest value, DN: what the camera says, else what the format can hold."""
    most = (1 << pixels.bits) - 1
    if not nodes.available("PixelDynamicRangeMax"):
        return most
    stated = int(nodes.number("PixelDynamicRangeMax"))
    return stated if 0 < stated <= most else most
