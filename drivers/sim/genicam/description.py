"""GenICam XML of the simulated machine vision camera.

Other people's parsers take it: the package `genicam` and Aravis.
"""

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.genicam.chunks import ByteOrder
from drivers.sim.genicam import xml
from drivers.sim.genicam.feature_registers import CHUNK_EXPOSURE, LINES, SETS, THROUGHPUT, Feature


@dataclass(frozen=True)
class Transport:
    """Transport-specific properties.

    name: as StandardNameSpace has it; order: of registers; texts: address and bytes of vendor, model and
    serial number; latch, timestamp: registers, the first with what is written to it; sources: of triggers,
    beyond software and lines; categories, parts: what its description has in addition.
    """

    name: str
    order: ByteOrder
    texts: tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
    latch: tuple[int, int]
    timestamp: int
    sources: dict[str, int]
    categories: dict[str, tuple[str, ...]]
    parts: tuple[str, ...]


_TEXTS = ("VendorName", "ModelName", "SerialNumber")
_CATEGORIES: dict[str, tuple[str, ...]] = {
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

_ON = {"Off": 0, "On": 1}
_LINES = {f"Line{number}": number for number in range(LINES)}


def describe(
    model: str,
    size: tuple[int, int],
    formats: Mapping[str, int],
    times: tuple[float, float],
    iso: float,
    transport: Transport,
) -> str:
    """The XML. size: width, height; formats: codes by name; times: us; iso: the largest."""
    categories = _CATEGORIES | transport.categories
    parts = [
        xml.category("Root", categories),
        *(xml.category(name, features) for name, features in categories.items()),
        *_device(transport),
        *_image(size, formats),
        *_acquisition(times),
        *_triggers(transport),
        *_lines(transport),
        *_analog(iso),
        *_chunks(),
        *_sequencer(),
        *_transport(),
        *transport.parts,
        '<Port Name="Device"/>',
        f'<Port Name="ChunkExposurePort"><ChunkID>{CHUNK_EXPOSURE:08x}</ChunkID></Port>',
    ]
    guid = "9a1a52ac-6c3e-4a2f-8d0e-5a1b0c2d3e4f"
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f'<RegisterDescription ModelName="{model.replace(" ", "_")}" VendorName="hdr_rig" '
        f'ToolTip="Simulated camera" StandardNameSpace="{transport.name}" SchemaMajorVersion="1" '
        'SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" '
        f'SubMinorVersion="0" ProductGuid="{guid}" VersionGuid="{guid}" '
        'xmlns="http://www.genicam.org/GenApi/Version_1_1" '
        'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation='
        '"http://www.genicam.org/GenApi/Version_1_1 http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd">\n'
        + "\n".join(parts).replace("LittleEndian", f"{transport.order.title()}Endian")
        + "\n</RegisterDescription>\n"
    )


def _device(transport: Transport) -> list[str]:
    """Names of the device, and its clock."""
    return [
        *(
            xml.text(f"Device{what}", address, length)
            for what, (address, length) in zip(_TEXTS, transport.texts, strict=True)
        ),
        xml.command("TimestampLatch", *transport.latch),
        '<Integer Name="TimestampLatchValue"><pValue>TimestampLatchValueReg</pValue><Min>0</Min>'
        f"<Max>{(1 << 63) - 1}</Max></Integer>",
        xml.register("IntReg", "TimestampLatchValueReg", transport.timestamp, length=8, access="RO"),
    ]


def _image(size: tuple[int, int], formats: Mapping[str, int]) -> list[str]:
    """Size and format of a frame; formats: codes by name."""
    width, height = size
    return [
        xml.integer("SensorWidth", Feature.SENSOR_WIDTH, 1, width, access="RO"),
        xml.integer("SensorHeight", Feature.SENSOR_HEIGHT, 1, height, access="RO"),
        xml.integer("Width", Feature.WIDTH, 1, "WidthMost"),
        xml.integer("Height", Feature.HEIGHT, 1, "HeightMost"),
        xml.integer("OffsetX", Feature.OFFSET_X, 0, "OffsetXMost"),
        xml.integer("OffsetY", Feature.OFFSET_Y, 0, "OffsetYMost"),
        xml.knife("WidthMost", {"ALL": "SensorWidth", "OFFSET": "OffsetXReg"}, "ALL - OFFSET"),
        xml.knife("HeightMost", {"ALL": "SensorHeight", "OFFSET": "OffsetYReg"}, "ALL - OFFSET"),
        xml.knife("OffsetXMost", {"ALL": "SensorWidth", "SIZE": "WidthReg"}, "ALL - SIZE"),
        xml.knife("OffsetYMost", {"ALL": "SensorHeight", "SIZE": "HeightReg"}, "ALL - SIZE"),
        xml.enumeration("PixelFormat", Feature.PIXEL_FORMAT, formats),
        xml.integer("PixelDynamicRangeMax", Feature.DYNAMIC_RANGE_MAX, 0, 0xFFFF, access="RO"),
    ]


def _acquisition(times: tuple[float, float]) -> list[str]:
    """Acquisition and exposure; times: the shortest and the longest, us."""
    return [
        xml.enumeration(
            "AcquisitionMode",
            Feature.ACQUISITION_MODE,
            {"Continuous": 0, "SingleFrame": 1, "MultiFrame": 2},
        ),
        xml.command("AcquisitionStart", Feature.ACQUISITION_START),
        xml.command("AcquisitionStop", Feature.ACQUISITION_STOP),
        xml.integer("AcquisitionFrameCount", Feature.FRAME_COUNT, 1, 65535),
        xml.integer("AcquisitionBurstFrameCount", Feature.BURST_COUNT, 1, 255),
        '<Float Name="AcquisitionResultingFrameRate"><pValue>FrameRateFormula</pValue><Unit>Hz</Unit></Float>'
        '<SwissKnife Name="FrameRateFormula"><pVariable Name="TIME">ExposureTimeReg</pVariable>'
        "<Formula>1000000 / (TIME + 1000)</Formula></SwissKnife>",
        '<Enumeration Name="ExposureMode"><EnumEntry Name="Timed"><Value>1</Value></EnumEntry>'
        "<Value>1</Value></Enumeration>",
        f'<Float Name="ExposureTime"><pValue>ExposureTimeReg</pValue><Min>{times[0]!r}</Min>'
        f"<Max>{times[1]!r}</Max><Unit>us</Unit></Float>",
        xml.register("FloatReg", "ExposureTimeReg", Feature.EXPOSURE_TIME, length=8),
    ]


def _triggers(transport: Transport) -> list[str]:
    """Triggers of a frame and of a burst."""
    sources = {"Software": 0} | {name: 1 + number for name, number in _LINES.items()} | transport.sources
    return [
        xml.enumeration("TriggerSelector", Feature.TRIGGER_SELECTOR, {"FrameStart": 0, "FrameBurstStart": 1}),
        xml.enumeration("TriggerMode", None, _ON),
        xml.enumeration("TriggerSource", None, sources, locked="TriggerModeReg"),
        # Masked, so that no reader of other registers than ours is led out of them.
        xml.knife("TriggerIndex", {"CHOSEN": "TriggerSelectorReg"}, "CHOSEN & 1"),
        xml.knife("LineIndex", {"CHOSEN": "LineSelectorReg"}, "CHOSEN & 3"),
        xml.knife("BlackLevelIndex", {"CHOSEN": "BlackLevelSelectorReg"}, "CHOSEN & 3"),
        xml.enumeration("TriggerActivation", None, {"RisingEdge": 0, "FallingEdge": 1}),
        xml.selected(
            "TriggerControl",
            Feature.TRIGGER_CONTROL,
            "TriggerIndex",
            {"TriggerModeReg": (0, 0), "TriggerSourceReg": (4, 7), "TriggerActivationReg": (8, 8)},
            transport.order,
        ),
        xml.command("TriggerSoftware", Feature.TRIGGER_SOFTWARE),
    ]


def _lines(transport: Transport) -> list[str]:
    """Lines of the connector, in and out."""
    return [
        xml.enumeration("LineSelector", Feature.LINE_SELECTOR, _LINES),
        '<Enumeration Name="LineMode"><EnumEntry Name="Input"><Value>0</Value></EnumEntry>'
        '<EnumEntry Name="Output"><pIsAvailable>LineSelectorReg</pIsAvailable><Value>1</Value></EnumEntry>'
        "<pValue>LineModeReg</pValue></Enumeration>",
        '<Enumeration Name="LineSource"><pIsAvailable>LineModeReg</pIsAvailable>'
        '<EnumEntry Name="Off"><Value>0</Value></EnumEntry>'
        '<EnumEntry Name="ExposureActive"><Value>1</Value></EnumEntry>'
        "<pValue>LineSourceReg</pValue></Enumeration>",
        xml.selected(
            "LineControl",
            Feature.LINE_CONTROL,
            "LineIndex",
            {"LineModeReg": (0, 0), "LineSourceReg": (4, 4)},
            transport.order,
        ),
    ]


def _analog(iso: float) -> list[str]:
    """Gain up to that of the largest ISO, and black levels."""
    return [
        '<Float Name="Gain"><pValue>GainConverter</pValue><Unit>dB</Unit></Float>'
        '<Converter Name="GainConverter"><FormulaTo>1000 * (10 ** (FROM / 20))</FormulaTo>'
        "<FormulaFrom>20 * LG(TO / 1000)</FormulaFrom><pValue>GainRaw</pValue>"
        "<Slope>Increasing</Slope></Converter>",
        xml.integer("GainRaw", Feature.GAIN, 1000, round(10 * iso)),
        xml.enumeration(
            "BlackLevelSelector", Feature.BLACK_SELECTOR, {"All": 0, "Red": 1, "Green": 2, "Blue": 3}
        ),
        '<Float Name="BlackLevel"><pValue>BlackLevelReg</pValue><Unit>DN</Unit></Float>',
        xml.register(
            "FloatReg",
            "BlackLevelReg",
            Feature.BLACK_LEVEL,
            length=8,
            access="RO",
            index=("BlackLevelIndex", 8),
        ),
    ]


def _chunks() -> list[str]:
    """Exposure time in the data of a frame."""
    return [
        xml.boolean("ChunkModeActive", Feature.CHUNK_MODE),
        xml.enumeration("ChunkSelector", Feature.CHUNK_SELECTOR, {"ExposureTime": 1}),
        xml.boolean("ChunkEnable", Feature.CHUNK_ENABLE),
        '<Float Name="ChunkExposureTime"><pValue>ChunkExposureTimeReg</pValue><Unit>us</Unit></Float>',
        xml.register("FloatReg", "ChunkExposureTimeReg", 0, length=8, access="RO", port="ChunkExposurePort"),
    ]


def _sequencer() -> list[str]:
    """Sets of settings that frames go through."""
    return [
        xml.enumeration("SequencerMode", Feature.SEQUENCER_MODE, _ON),
        xml.enumeration("SequencerConfigurationMode", Feature.SEQUENCER_CONFIGURATION, _ON),
        xml.integer("SequencerSetSelector", Feature.SET_SELECTOR, 0, SETS - 1),
        xml.command("SequencerSetSave", Feature.SET_SAVE),
        xml.integer("SequencerSetStart", Feature.SET_START, 0, SETS - 1),
        xml.integer("SequencerSetNext", Feature.SET_NEXT, 0, SETS - 1),
        xml.integer("SequencerPathSelector", Feature.PATH_SELECTOR, 0, 0),
        xml.enumeration("SequencerTriggerSource", Feature.SEQUENCER_SOURCE, {"Off": 0, "FrameEnd": 1}),
    ]


def _transport() -> list[str]:
    """Size and rate of the stream."""
    return [
        '<Integer Name="PayloadSize"><pValue>PayloadFormula</pValue><Unit>B</Unit></Integer>',
        xml.knife(
            "PayloadFormula",
            {"W": "WidthReg", "H": "HeightReg", "F": "PixelFormatReg", "C": "ChunkModeActiveReg"},
            "(W * H * ((F >> 16) & 255) + 7) / 8 + ((C = 1) ? 24 : 0)",
        ),
        xml.enumeration("DeviceLinkThroughputLimitMode", Feature.THROUGHPUT_MODE, _ON),
        xml.integer(
            "DeviceLinkThroughputLimit",
            Feature.THROUGHPUT_LIMIT,
            *THROUGHPUT,
            step=THROUGHPUT[0],
            available="DeviceLinkThroughputLimitModeReg",
        ),
    ]


def zipped(text: str) -> bytes:
    """Zip the description, as the manifest offers it; the same bytes each time."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("simulated.xml", (2026, 1, 1, 0, 0, 0)), text, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
