"""Gains of single colours, made equal: the white balance of a camera, and its Gain by colour.

Makers say that both act on raw mosaics (Basler dart: "effective on all pixel data output formats including
raw"). A ratio that is a factor does nothing at 1. For integer ratios the maker chooses the neutral value (64,
256, 1024, 4096); only green, the reference of the ratios, shows it.
"""

from collections.abc import Iterator
from contextlib import suppress

from drivers.errors import CameraRefused
from drivers.genicam import units
from drivers.genicam.nodemap import NodeMap

_FACTORS = ("BalanceRatio", "BalanceRatioAbs")
_WHOLE = ("BalanceRatio", "BalanceRatioAbs", "BalanceRatioRaw")
_SWITCHES = ("BalanceWhiteEnable", "BalanceRatioEnable")
_GREEN = ("Green", "GreenRed", "GreenBlue")
_COLOURS = (*_GREEN[1:], "Red", "Green", "Blue")
"""Suffixes of the entries of GainSelector that are colours; the longer of two comes first."""
_ALIKE = 0.005
"""Relative tolerance of equal gains where a camera counts in steps."""
_DECIBEL = 0.05


def even_out(nodes: NodeMap, name: str) -> None:
    """Set equal gains for all colours, and read them back. CameraRefused if one differs.

    name: of the camera, for messages.
    """
    _balance(nodes, name)
    if nodes.available("Gain") and nodes.writable("GainSelector"):
        before = nodes.text("GainSelector")
        try:
            _gains(nodes, name)
        finally:
            nodes.set("GainSelector", before)


def _balance(nodes: NodeMap, name: str) -> None:
    if any(nodes.available(one) and not nodes.number(one) for one in _SWITCHES):
        return
    factors = [one for one in _FACTORS if nodes.available(one) and nodes.kind(one) != "Integer"]
    others = [one for one in _WHOLE if nodes.available(one)]
    if not others:
        return
    ratio = (*factors, *others)[0]
    # A percentage is the one unit in whole numbers that means the same everywhere.
    neutral = 1.0 if factors else 100.0 if nodes.unit(ratio).strip() == "%" else None
    entries = nodes.entries("BalanceRatioSelector") if nodes.writable("BalanceRatioSelector") else ()
    if neutral is None:
        green = next((entry for entry in entries if entry in _GREEN), None)
        if green is None or not _chosen(nodes, "BalanceRatioSelector", green):
            raise _refusal(name, f"{ratio} is {nodes.number(ratio):g}, in a unit of its own")
        neutral = float(nodes.number(ratio))
    for entry in _each(nodes, "BalanceRatioSelector", entries):
        value = _put(nodes, ratio, neutral)
        if abs(value - neutral) > _ALIKE * neutral:
            raise _refusal(name, f"{entry}{ratio} is {value:g}, where {neutral:g} does nothing")


def _gains(nodes: NodeMap, name: str) -> None:
    """Gains by colour beside the common one, for each stage, analog or digital."""
    neutral = {"dB": 0.0, "factor": 1.0, None: None}[units.gain_unit(nodes)]
    stages: dict[str, dict[str, str]] = {}
    for entry in nodes.entries("GainSelector"):
        colour = next((one for one in _COLOURS if entry.endswith(one)), None)
        if colour is not None:
            stages.setdefault(entry.removesuffix(colour), {})[colour] = entry
    for colours in stages.values():
        green = next((colours[one] for one in _GREEN if one in colours), next(iter(colours.values())))
        if not _chosen(nodes, "GainSelector", green):
            continue
        goal = _put(nodes, "Gain", float(nodes.number("Gain")) if neutral is None else neutral)
        close = _DECIBEL if neutral == 0.0 else _ALIKE * goal
        for entry in _each(nodes, "GainSelector", tuple(colours.values())):
            value = _put(nodes, "Gain", goal)
            if abs(value - goal) > close:
                raise _refusal(name, f"{entry}Gain is {value:g}, where {green} is {goal:g}")


def _put(nodes: NodeMap, amount: str, goal: float) -> float:
    """Set an amount, if it can be set; what it then is."""
    if nodes.writable(amount):
        with suppress(CameraRefused):  # what it then is, is read back
            nodes.set_nearest(amount, goal)
    return float(nodes.number(amount))


def _each(nodes: NodeMap, selector: str, entries: tuple[str, ...]) -> Iterator[str]:
    """Each entry, chosen, as the beginning of what is said of it; once, as "", without entries."""
    if not entries:
        yield ""
    for entry in entries:
        if _chosen(nodes, selector, entry):
            yield f"{selector} {entry}: "


def _chosen(nodes: NodeMap, selector: str, entry: str) -> bool:
    """Select an entry; False where this pixel format does not support it."""
    try:
        nodes.set(selector, entry)
    except CameraRefused:
        return False
    return True


def _refusal(name: str, what: str) -> CameraRefused:
    return CameraRefused(
        f"{name} changes every frame by its white balance and cannot be kept from it ({what}): switch it off "
        "by its maker's program, or take another camera."
    )
