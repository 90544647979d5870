"""Times, gains, black levels and rates by the unit that a description states; steps; what is unknown."""

import math
import struct

import numpy as np
import pytest

from drivers.errors import CameraRefused
from drivers.genicam import settings, units
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.pixels import BY_NAME
from imaging.optics.exposure import Exposure

from .nodemap.nodes import Bytes, node_map

PIXELS = BY_NAME["BayerRG12"]


def number(name: str, unit: str | None, low: float, high: float, more: str = "") -> str:
    stated = "" if unit is None else f"<Unit>{unit}</Unit>"
    return (
        f'<Float Name="{name}"><pValue>{name}Reg</pValue><Min>{low}</Min>'
        f"<Max>{high}</Max>{more}{stated}</Float>"
        f'<FloatReg Name="{name}Reg"><Address>{0x10 if name == "Gain" else 0}</Address><Length>8</Length>'
        "<AccessMode>RW</AccessMode><pPort>Device</pPort></FloatReg>"
    )


def held(memory: Bytes, address: int = 0) -> float:
    return float(struct.unpack_from("<d", memory.data, address)[0])


@pytest.mark.parametrize("name", ["ExposureTime", "ExposureTimeAbs"])
@pytest.mark.parametrize(
    ("unit", "second"),
    [
        *(
            ("s", 1.0),
            ("sec", 1.0),
            ("ms", 1e3),
            ("us", 1e6),
            ("\u00b5s", 1e6),
            ("\u03bcs", 1e6),
            ("ns", 1e9),
        ),
        *((" [us] ", 1e6), ("uS", 1e6), (None, 1e6)),
    ],
)
def test_a_time_is_set_and_read_in_its_unit(name: str, unit: str | None, second: float) -> None:
    memory = Bytes()
    nodes = node_map(number(name, unit, 1e-5 * second, 10 * second), memory)
    assert settings.set_exposure(nodes, Exposure(time=0.01)).time == pytest.approx(0.01, rel=1e-12)
    assert held(memory) == pytest.approx(0.01 * second, rel=1e-12)


def test_a_time_in_an_unknown_unit_is_refused() -> None:
    nodes = node_map(number("ExposureTime", "lines", 1, 4000))
    with pytest.raises(CameraRefused, match=r"ExposureTime is in 'lines', which rig does not know"):
        settings.set_exposure(nodes, Exposure(time=0.01))


@pytest.mark.parametrize(
    ("node", "applied"),
    [
        # 20 + 285 * 35 is the nearest to 10,000.
        ('<Integer Name="ExposureTimeAbs"><pValue>R</pValue><Min>20</Min><Max>1000010</Max>'
         '<Inc>35</Inc></Integer>', 9995),
        ('<Integer Name="ExposureTime"><pValue>R</pValue></Integer>', 10000),
        ('<Float Name="ExposureTime"><pValue>R</pValue></Float>', 10000),
        ('<Float Name="ExposureTime"><pValue>R</pValue><Min>20</Min><Max>1000010</Max><Inc>35</Inc>'
         '</Float>', 9995),
        ('<Float Name="ExposureTime"><pValue>I</pValue></Float><Integer Name="I"><pValue>R</pValue>'
         '<Min>20</Min>'
         "<Max>1000010</Max><pInc>S</pInc></Integer><Integer Name=\"S\"><Value>35</Value></Integer>", 9995),
        ('<Integer Name="ExposureTime"><pValue>R</pValue>'
         '<ValidValueSet>100;5000;9000;20000</ValidValueSet></Integer>', 9000),
        ('<Float Name="ExposureTime"><pValue>C</pValue></Float><Converter Name="C">'
         '<FormulaTo>FROM / 10</FormulaTo>'
         "<FormulaFrom>TO * 10</FormulaFrom><pValue>I</pValue></Converter><Integer Name=\"I\">"
         "<pValue>R</pValue>"
         "<Min>2</Min><Max>100000</Max><Inc>7</Inc></Integer>", 10030),
    ],
)  # fmt: skip
def test_a_time_that_goes_in_steps_is_the_nearest(node: str, applied: int) -> None:
    register = (
        '<IntReg Name="R"><Address>0</Address><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort></IntReg>"
    )
    nodes = node_map(node + register)
    assert settings.set_exposure(nodes, Exposure(time=0.01)).time == pytest.approx(applied * 1e-6)
    # Between whole numbers, too.
    assert settings.set_exposure(nodes, Exposure(time=1 / 240)).time == pytest.approx(1 / 240, rel=0.21)


TIME = number("ExposureTime", "us", 10, 1e7)


@pytest.mark.parametrize(
    ("unit", "low", "high", "gain"),
    [
        ("dB", 0, 24, 20 * math.log10(4)),
        ("db", 0, 24, 20 * math.log10(4)),
        ("x", 1, 16, 4.0),
        ("factor", 1, 16, 4),
    ],
)
def test_an_iso_is_a_gain_in_its_unit(unit: str, low: float, high: float, gain: float) -> None:
    memory = Bytes()
    nodes = node_map(TIME + number("Gain", unit, low, high), memory)
    assert settings.set_exposure(nodes, Exposure(time=0.01, iso=400)) == Exposure(time=0.01, iso=400)
    assert held(memory, 0x10) == pytest.approx(gain)


def made_by(vendor: str, inside: str) -> NodeMap:
    xml = f'<RegisterDescription VendorName="{vendor}">{inside}<Port Name="Device"/></RegisterDescription>'
    return NodeMap(xml.encode(), Bytes(), "the camera")


@pytest.mark.parametrize(
    ("vendor", "expected"),
    [("Allied_Vision_Technologies", "dB"), ("Chromasens", "factor"), ("Somebody", None)],
)
def test_a_gain_without_a_unit_is_what_its_maker_says_or_unknown(vendor: str, expected: str | None) -> None:
    nodes = made_by(vendor, TIME + number("Gain", None, 1, 16))
    assert units.gain_unit(nodes) == expected
    if expected is None:
        assert settings.set_exposure(nodes, Exposure(time=0.01)).iso is None
        with pytest.raises(CameraRefused, match=r"its gain has no unit, and may be in dB or a factor"):
            settings.set_exposure(nodes, Exposure(time=0.01, iso=400))


@pytest.mark.parametrize(
    ("unit", "value", "black"),
    [
        ("%", 1.3675, 56.0),
        ("percent", 1.3675, 56.0),
        ("DN", 56.0, 56.0),
        (None, 56.0, None),
        ("mV", 56.0, None),
    ],
)
def test_a_black_level_is_in_its_unit_or_unknown(unit: str | None, value: float, black: float | None) -> None:
    nodes = node_map(number("BlackLevel", unit, 0, 100))
    nodes.set("BlackLevel", value)
    levels = settings.black_levels(nodes, PIXELS, 4095)
    if black is None:
        assert levels is None
    else:
        assert np.array(levels) == pytest.approx(np.full((2, 2), black), abs=0.01)
    assert settings.black_levels(node_map(""), PIXELS, 4095) is None


@pytest.mark.parametrize(
    ("unit", "scale"),
    [(None, 1.0), ("Bps", 1.0), ("MBps", 1e6), ("MB/s", 1e6), ("Mbps", 125e3), ("KBps", 1e3)],
)
def test_a_rate_is_in_its_unit(unit: str | None, scale: float) -> None:
    assert units.bytes_per_second(node_map(number("Rate", unit, 0, 1e9)), "Rate") == pytest.approx(scale)
