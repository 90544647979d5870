"""The GenICam XML of the simulated machine vision camera, and where its registers are.

Elements stand in the order that the GenApi schema 1.1 wants, so that other people's parsers take it.
"""

import io
import zipfile
from collections.abc import Iterable, Mapping
from enum import IntEnum

from drivers.u3v.registers import Abrm

CHUNK_EXPOSURE, CHUNK_IMAGE = 0x1001, 0x1000
LINES = 3
"""Line0 is an input; Line1 and Line2 can be either."""
SETS = 8
"""Sets of the sequencer."""
THROUGHPUT = (1_000_000, 400_000_000)
"""Bytes per second that the link can be limited to; also the step."""


class Feature(IntEnum):
    """Addresses of the feature registers: 4 bytes each, times and black levels 8."""

    WIDTH = 0x10000
    HEIGHT = 0x10008
    OFFSET_X = 0x10010
    OFFSET_Y = 0x10018
    SENSOR_WIDTH = 0x10020
    SENSOR_HEIGHT = 0x10028
    PIXEL_FORMAT = 0x10030
    DYNAMIC_RANGE_MAX = 0x10038
    ACQUISITION_MODE = 0x10040
    ACQUISITION_START = 0x10048
    ACQUISITION_STOP = 0x10050
    FRAME_COUNT = 0x10058
    BURST_COUNT = 0x10060
    TRIGGER_SELECTOR = 0x10068
    TRIGGER_CONTROL = 0x10070
    """One for each trigger: bit 0 is the mode, bits 4 to 7 are the source, bit 8 is 1 for falling edges."""
    TRIGGER_SOFTWARE = 0x10080
    EXPOSURE_TIME = 0x10088
    GAIN = 0x10090
    """Thousandths of the linear gain."""
    BLACK_SELECTOR = 0x10098
    BLACK_LEVEL = 0x100A0
    """For all, red, green, blue."""
    CHUNK_MODE = 0x100C0
    CHUNK_SELECTOR = 0x100C8
    CHUNK_ENABLE = 0x100D0
    THROUGHPUT_MODE = 0x100D8
    THROUGHPUT_LIMIT = 0x100E0
    SEQUENCER_MODE = 0x100E8
    SEQUENCER_CONFIGURATION = 0x100F0
    SET_SELECTOR = 0x100F8
    SET_SAVE = 0x10100
    SET_START = 0x10108
    SET_NEXT = 0x10110
    PATH_SELECTOR = 0x10118
    SEQUENCER_SOURCE = 0x10120
    LINE_SELECTOR = 0x10128
    LINE_CONTROL = 0x10130
    """One for each line: bit 0 is 1 for an output, bit 4 is 1 where that shows exposures."""


READ_ONLY = (Feature.SENSOR_WIDTH, Feature.SENSOR_HEIGHT, Feature.DYNAMIC_RANGE_MAX)
_CATEGORIES = {
    "DeviceControl": (
        *("DeviceVendorName", "DeviceModelName", "DeviceSerialNumber"),
        *("TimestampLatch", "TimestampLatchValue"),
    ),
    "ImageFormatControl": (
        *("SensorWidth", "SensorHeight", "Width", "Height", "OffsetX", "OffsetY"),
        *("PixelFormat", "PixelDynamicRangeMax"),
    ),
    "AcquisitionControl": (
        *("AcquisitionMode", "AcquisitionStart", "AcquisitionStop", "AcquisitionFrameCount"),
        *("AcquisitionBurstFrameCount", "AcquisitionResultingFrameRate", "ExposureMode", "ExposureTime"),
        *("TriggerSelector", "TriggerMode", "TriggerSource", "TriggerActivation", "TriggerSoftware"),
    ),
    "DigitalIOControl": ("LineSelector", "LineMode", "LineSource"),
    "AnalogControl": ("Gain", "BlackLevelSelector", "BlackLevel"),
    "ChunkDataControl": ("ChunkModeActive", "ChunkSelector", "ChunkEnable", "ChunkExposureTime"),
    "SequencerControl": (
        *("SequencerMode", "SequencerConfigurationMode", "SequencerSetSelector", "SequencerSetSave"),
        *("SequencerSetStart", "SequencerSetNext", "SequencerPathSelector", "SequencerTriggerSource"),
    ),
    "TransportLayerControl": (
        *("PayloadSize", "DeviceLinkThroughputLimitMode", "DeviceLinkThroughputLimit"),
    ),
}


def describe(
    model: str, size: tuple[int, int], formats: Mapping[str, int], times: tuple[float, float], iso: float
) -> str:
    """The XML. size: width, height; formats: codes by name; times: us; iso: the largest."""
    width, height = size
    on = {"Off": 0, "On": 1}
    lines = {f"Line{number}": number for number in range(LINES)}
    sources = {"Software": 0} | {name: 1 + number for name, number in lines.items()}
    parts = [
        _category("Root", _CATEGORIES),
        *(_category(name, features) for name, features in _CATEGORIES.items()),
        _text("DeviceVendorName", 0x004),
        _text("DeviceModelName", 0x044),
        _text("DeviceSerialNumber", 0x144),
        _command("TimestampLatch", Abrm.LATCH),
        '<Integer Name="TimestampLatchValue"><pValue>TimestampLatchValueReg</pValue><Min>0</Min>'
        f"<Max>{(1 << 63) - 1}</Max></Integer>",
        _register("IntReg", "TimestampLatchValueReg", Abrm.TIMESTAMP, length=8, access="RO"),
        _integer("SensorWidth", Feature.SENSOR_WIDTH, 1, width),
        _integer("SensorHeight", Feature.SENSOR_HEIGHT, 1, height),
        _integer("Width", Feature.WIDTH, 1, "WidthMost"),
        _integer("Height", Feature.HEIGHT, 1, "HeightMost"),
        _integer("OffsetX", Feature.OFFSET_X, 0, "OffsetXMost"),
        _integer("OffsetY", Feature.OFFSET_Y, 0, "OffsetYMost"),
        _knife("WidthMost", {"ALL": "SensorWidth", "OFFSET": "OffsetXReg"}, "ALL - OFFSET"),
        _knife("HeightMost", {"ALL": "SensorHeight", "OFFSET": "OffsetYReg"}, "ALL - OFFSET"),
        _knife("OffsetXMost", {"ALL": "SensorWidth", "SIZE": "WidthReg"}, "ALL - SIZE"),
        _knife("OffsetYMost", {"ALL": "SensorHeight", "SIZE": "HeightReg"}, "ALL - SIZE"),
        _enumeration("PixelFormat", Feature.PIXEL_FORMAT, formats),
        _integer("PixelDynamicRangeMax", Feature.DYNAMIC_RANGE_MAX, 0, 0xFFFF),
        _enumeration(
            "AcquisitionMode",
            Feature.ACQUISITION_MODE,
            {"Continuous": 0, "SingleFrame": 1, "MultiFrame": 2},
        ),
        _command("AcquisitionStart", Feature.ACQUISITION_START),
        _command("AcquisitionStop", Feature.ACQUISITION_STOP),
        _integer("AcquisitionFrameCount", Feature.FRAME_COUNT, 1, 65535),
        _integer("AcquisitionBurstFrameCount", Feature.BURST_COUNT, 1, 255),
        '<Float Name="AcquisitionResultingFrameRate"><pValue>FrameRateFormula</pValue><Unit>Hz</Unit></Float>'
        '<SwissKnife Name="FrameRateFormula"><pVariable Name="TIME">ExposureTimeReg</pVariable>'
        "<Formula>1000000 / (TIME + 1000)</Formula></SwissKnife>",
        '<Enumeration Name="ExposureMode"><EnumEntry Name="Timed"><Value>1</Value></EnumEntry>'
        "<Value>1</Value></Enumeration>",
        f'<Float Name="ExposureTime"><pValue>ExposureTimeReg</pValue><Min>{times[0]!r}</Min>'
        f"<Max>{times[1]!r}</Max><Unit>us</Unit></Float>",
        _register("FloatReg", "ExposureTimeReg", Feature.EXPOSURE_TIME, length=8),
        _enumeration("TriggerSelector", Feature.TRIGGER_SELECTOR, {"FrameStart": 0, "FrameBurstStart": 1}),
        _enumeration("TriggerMode", None, on),
        _enumeration("TriggerSource", None, sources),
        # Masked, so that no reader of other registers than ours is led out of them.
        _knife("TriggerIndex", {"CHOSEN": "TriggerSelectorReg"}, "CHOSEN & 1"),
        _knife("LineIndex", {"CHOSEN": "LineSelectorReg"}, "CHOSEN & 3"),
        _knife("BlackLevelIndex", {"CHOSEN": "BlackLevelSelectorReg"}, "CHOSEN & 3"),
        _enumeration("TriggerActivation", None, {"RisingEdge": 0, "FallingEdge": 1}),
        _selected(
            "TriggerControl",
            Feature.TRIGGER_CONTROL,
            "TriggerIndex",
            {"TriggerModeReg": (0, 0), "TriggerSourceReg": (4, 7), "TriggerActivationReg": (8, 8)},
        ),
        _command("TriggerSoftware", Feature.TRIGGER_SOFTWARE),
        _enumeration("LineSelector", Feature.LINE_SELECTOR, lines),
        '<Enumeration Name="LineMode"><EnumEntry Name="Input"><Value>0</Value></EnumEntry>'
        '<EnumEntry Name="Output"><pIsAvailable>LineSelectorReg</pIsAvailable><Value>1</Value></EnumEntry>'
        "<pValue>LineModeReg</pValue></Enumeration>",
        '<Enumeration Name="LineSource"><pIsAvailable>LineModeReg</pIsAvailable>'
        '<EnumEntry Name="Off"><Value>0</Value></EnumEntry>'
        '<EnumEntry Name="ExposureActive"><Value>1</Value></EnumEntry>'
        "<pValue>LineSourceReg</pValue></Enumeration>",
        _selected(
            "LineControl",
            Feature.LINE_CONTROL,
            "LineIndex",
            {"LineModeReg": (0, 0), "LineSourceReg": (4, 4)},
        ),
        '<Float Name="Gain"><pValue>GainConverter</pValue><Unit>dB</Unit></Float>'
        '<Converter Name="GainConverter"><FormulaTo>1000 * (10 ** (FROM / 20))</FormulaTo>'
        "<FormulaFrom>20 * LG(TO / 1000)</FormulaFrom><pValue>GainRaw</pValue>"
        "<Slope>Increasing</Slope></Converter>",
        _integer("GainRaw", Feature.GAIN, 1000, round(10 * iso)),
        _enumeration(
            "BlackLevelSelector", Feature.BLACK_SELECTOR, {"All": 0, "Red": 1, "Green": 2, "Blue": 3}
        ),
        '<Float Name="BlackLevel"><pValue>BlackLevelReg</pValue></Float>',
        _register(
            "FloatReg",
            "BlackLevelReg",
            Feature.BLACK_LEVEL,
            length=8,
            access="RO",
            index=("BlackLevelIndex", 8),
        ),
        _boolean("ChunkModeActive", Feature.CHUNK_MODE),
        _enumeration("ChunkSelector", Feature.CHUNK_SELECTOR, {"ExposureTime": 1}),
        _boolean("ChunkEnable", Feature.CHUNK_ENABLE),
        '<Float Name="ChunkExposureTime"><pValue>ChunkExposureTimeReg</pValue><Unit>us</Unit></Float>',
        _register("FloatReg", "ChunkExposureTimeReg", 0, length=8, access="RO", port="ChunkExposurePort"),
        _enumeration("SequencerMode", Feature.SEQUENCER_MODE, on),
        _enumeration("SequencerConfigurationMode", Feature.SEQUENCER_CONFIGURATION, on),
        _integer("SequencerSetSelector", Feature.SET_SELECTOR, 0, SETS - 1),
        _command("SequencerSetSave", Feature.SET_SAVE),
        _integer("SequencerSetStart", Feature.SET_START, 0, SETS - 1),
        _integer("SequencerSetNext", Feature.SET_NEXT, 0, SETS - 1),
        _integer("SequencerPathSelector", Feature.PATH_SELECTOR, 0, 0),
        _enumeration("SequencerTriggerSource", Feature.SEQUENCER_SOURCE, {"Off": 0, "FrameEnd": 1}),
        '<Integer Name="PayloadSize"><pValue>PayloadFormula</pValue><Unit>B</Unit></Integer>',
        _knife(
            "PayloadFormula",
            {"W": "WidthReg", "H": "HeightReg", "F": "PixelFormatReg", "C": "ChunkModeActiveReg"},
            "(W * H * ((F >> 16) & 255) + 7) / 8 + ((C = 1) ? 24 : 0)",
        ),
        _enumeration("DeviceLinkThroughputLimitMode", Feature.THROUGHPUT_MODE, on),
        _integer(
            "DeviceLinkThroughputLimit",
            Feature.THROUGHPUT_LIMIT,
            *THROUGHPUT,
            step=THROUGHPUT[0],
            available="DeviceLinkThroughputLimitModeReg",
        ),
        '<Port Name="Device"/>',
        f'<Port Name="ChunkExposurePort"><ChunkID>{CHUNK_EXPOSURE:08x}</ChunkID></Port>',
    ]
    guid = "9a1a52ac-6c3e-4a2f-8d0e-5a1b0c2d3e4f"
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f'<RegisterDescription ModelName="{model.replace(" ", "_")}" VendorName="hdr_rig" '
        'ToolTip="Simulated USB3 Vision camera" StandardNameSpace="USB" SchemaMajorVersion="1" '
        'SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" '
        f'SubMinorVersion="0" ProductGuid="{guid}" VersionGuid="{guid}" '
        'xmlns="http://www.genicam.org/GenApi/Version_1_1" '
        'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation='
        '"http://www.genicam.org/GenApi/Version_1_1 http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd">\n'
        + "\n".join(parts)
        + "\n</RegisterDescription>\n"
    )


def zipped(xml: str) -> bytes:
    """As the manifest offers it; the same bytes each time."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("simulated.xml", (2026, 1, 1, 0, 0, 0)), xml, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def _category(name: str, features: Iterable[str]) -> str:
    inside = "".join(f"<pFeature>{feature}</pFeature>" for feature in features)
    return f'<Category Name="{name}">{inside}</Category>'


def _register(
    kind: str,
    name: str,
    address: int,
    *,
    length: int = 4,
    access: str = "RW",
    port: str = "Device",
    index: tuple[str, int] | None = None,
) -> str:
    """A register; `index` is the node that chooses among several, and the bytes from one to the next."""
    chosen = "" if index is None else f'<pIndex Offset="{index[1]}">{index[0]}</pIndex>'
    sign = "<Sign>Unsigned</Sign>" if kind == "IntReg" else ""
    order = "" if kind == "StringReg" else "<Endianess>LittleEndian</Endianess>"
    return (
        f'<{kind} Name="{name}"><Address>{address:#x}</Address>{chosen}<Length>{length}</Length>'
        f"<AccessMode>{access}</AccessMode><pPort>{port}</pPort><Cachable>NoCache</Cachable>"
        f"{sign}{order}</{kind}>"
    )


def _text(name: str, address: int) -> str:
    return _register("StringReg", name, address, length=64, access="RO")


def _integer(
    name: str,
    address: Feature,
    low: int,
    high: int | str,
    *,
    step: int | None = None,
    available: str | None = None,
) -> str:
    """An Integer over a register; `high` may be a node."""
    most = f"<pMax>{high}</pMax>" if isinstance(high, str) else f"<Max>{high}</Max>"
    steps = "" if step is None else f"<Inc>{step}</Inc>"
    there = "" if available is None else f"<pIsAvailable>{available}</pIsAvailable>"
    access = "RO" if address in READ_ONLY else "RW"
    return (
        f'<Integer Name="{name}">{there}<pValue>{name}Reg</pValue><Min>{low}</Min>{most}{steps}</Integer>'
        + _register("IntReg", f"{name}Reg", address, access=access)
    )


def _knife(name: str, variables: Mapping[str, str], formula: str) -> str:
    given = "".join(f'<pVariable Name="{key}">{node}</pVariable>' for key, node in variables.items())
    safe = formula.replace("&", "&amp;").replace(">", "&gt;")
    return f'<IntSwissKnife Name="{name}">{given}<Formula>{safe}</Formula></IntSwissKnife>'


def _enumeration(name: str, address: Feature | None, entries: Mapping[str, int]) -> str:
    """An Enumeration over a register of its own, or over one that is described elsewhere."""
    inside = "".join(
        f'<EnumEntry Name="{entry}"><Value>{value}</Value></EnumEntry>' for entry, value in entries.items()
    )
    own = "" if address is None else _register("IntReg", f"{name}Reg", address)
    return f'<Enumeration Name="{name}">{inside}<pValue>{name}Reg</pValue></Enumeration>{own}'


def _boolean(name: str, address: Feature) -> str:
    return (
        f'<Boolean Name="{name}"><pValue>{name}Reg</pValue><OnValue>1</OnValue><OffValue>0</OffValue>'
        "</Boolean>" + _register("IntReg", f"{name}Reg", address)
    )


def _command(name: str, address: Feature | Abrm) -> str:
    return (
        f'<Command Name="{name}"><pValue>{name}Reg</pValue><CommandValue>1</CommandValue></Command>'
        + _register("IntReg", f"{name}Reg", address)
    )


def _selected(comment: str, address: int, selector: str, entries: Mapping[str, tuple[int, int]]) -> str:
    """A register for each value of a selector, cut into `entries`: lowest and highest bit by name."""
    inside = "".join(
        f'<StructEntry Name="{name}"><LSB>{low}</LSB><MSB>{high}</MSB></StructEntry>'
        for name, (low, high) in entries.items()
    )
    return (
        f'<StructReg Comment="{comment}"><Address>{address:#x}</Address>'
        f'<pIndex Offset="4">{selector}</pIndex><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><Cachable>NoCache</Cachable><Endianess>LittleEndian</Endianess>"
        f"{inside}</StructReg>"
    )
