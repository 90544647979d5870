"""Units of a camera's numbers: the `Unit` in its description, or the one in its maker's documents.

Without either the unit is unknown, and none is assumed: a gain of 12 may be 12 dB or a factor of 12.
"""

import math
from typing import Literal

from drivers.errors import CameraRefused
from drivers.genicam.nodemap import NodeMap

GainUnit = Literal["dB", "factor"]

_PER_SECOND = {
    **dict.fromkeys(("s", "sec", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e3),
    # casefold() makes one letter of both signs for micro, which is this one.
    **dict.fromkeys(("us", "usec", "\u03bcs", "microsecond", "microseconds"), 1e6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e9),
}
_GAINS: dict[str, GainUnit] = {
    **dict.fromkeys(("db", "decibel", "decibels"), "dB"),
    **dict.fromkeys(("x", "1", "factor", "times", "multiplier", "linear"), "factor"),
}
_GAIN_OF_MAKER: dict[str, GainUnit] = {
    # "GigE Camera and Driver Features" 3.0.0: "Gain ... Unit: dB".
    "allied vision": "dB",
    # "mvBlueFOX3 Technical Manual": "the selected gain as an absolute physical value in dB".
    "matrix vision": "dB",
    # "BG Series Instruction Manual": "Gain is in [dB] unit".
    "toshiba": "dB",
    # docs.chromasens.de, Analog Control: "the linear gain".
    "chromasens": "factor",
}
"""Units of Gain by the beginning of the maker's name, for descriptions without units."""
_PERCENT = ("%", "percent", "pct")
_LEVELS = ("dn", "adu", "lsb", "gray", "grey", "gray level", "gray levels", "grey level", "grey levels")
_BYTES = {
    f"{prefix}{what}": scale * size
    for prefix, scale in (("", 1.0), ("k", 1e3), ("K", 1e3), ("M", 1e6), ("G", 1e9))
    for size, names in ((1.0, ("Bps", "B/s")), (0.125, ("bps", "b/s", "bit/s")))
    for what in names
}
"""SFNC writes bytes a second as Bps; a small b is a bit, as in the Mbps of Basler's descriptions."""


def _stated(nodes: NodeMap, name: str) -> str:
    return nodes.unit(name).strip().strip("[]()").strip()


def _unit(nodes: NodeMap, name: str) -> str:
    return _stated(nodes, name).casefold()


def per_second(nodes: NodeMap, name: str) -> float:
    """Units of a time in a second; us where none is stated, as SFNC has it. CameraRefused."""
    unit = _unit(nodes, name)
    if unit not in _PER_SECOND and unit:
        raise _unknown(nodes, name, "s, ms, us and ns")
    return _PER_SECOND.get(unit, 1e6)


def bytes_per_second(nodes: NodeMap, name: str) -> float:
    """Bytes a second in 1 of a rate; where nothing is stated 1, as SFNC has it. CameraRefused."""
    unit = _stated(nodes, name)
    if unit not in _BYTES and unit:
        raise _unknown(nodes, name, "Bps, kBps, MBps and GBps, and the same in bits")
    return _BYTES.get(unit, 1.0)


def gain_unit(nodes: NodeMap) -> GainUnit | None:
    """Unit of Gain; None if neither the description nor the maker's documents state it."""
    unit = _unit(nodes, "Gain")
    if unit:
        return _GAINS.get(unit)
    maker = nodes.vendor.casefold()
    return next((known for name, known in _GAIN_OF_MAKER.items() if maker.startswith(name)), None)


def iso_of(gain: float, unit: GainUnit) -> float:
    """The ISO that a gain counts as."""
    return 100.0 * (math.pow(10.0, gain / 20.0) if unit == "dB" else gain)


def gain_of(iso: float, unit: GainUnit) -> float:
    """The gain that an ISO asks for."""
    return 20.0 * math.log10(iso / 100.0) if unit == "dB" else iso / 100.0


def black_scale(nodes: NodeMap, white: int) -> float | None:
    """DN in 1 of BlackLevel, white being the largest value; None if its unit is unknown."""
    unit = _unit(nodes, "BlackLevel")
    if unit in _PERCENT:
        return white / 100.0
    return 1.0 if unit in _LEVELS else None


def _unknown(nodes: NodeMap, name: str, known: str) -> CameraRefused:
    return CameraRefused(
        f"{nodes.where}: {name} is in {nodes.unit(name)!r}, which rig does not know (known: {known}): "
        "update the camera's firmware, or take another camera."
    )
