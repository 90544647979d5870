"""Quirks of real machine vision cameras that the plain simulated one lacks, switched on one by one.

Each was seen in a maker's manual, in a description of ADGenICam or in the issues of Aravis.
"""

import io
import zipfile
from collections.abc import Container, Mapping
from enum import Enum

from drivers.sim.genicam import xml


class Quirk(Enum):
    """A way of being otherwise."""

    CHUNK_PAYLOAD = "payload type 4: chunks, and a leader that states neither size nor format"
    EXTENDED_CHUNK_PAYLOAD = "payload type 5: chunks, and a leader as of an image"
    NO_EXPOSURE_CHUNK = "chunks, but none of the exposure time"
    PERCENT_BLACK = "BlackLevel in percent"
    SECONDS = "ExposureTime in seconds"
    GAIN_FACTOR = "Gain as a factor"
    NO_UNITS = "Gain and BlackLevel without a unit"
    GAMMA = "gamma of 0.8 and a white balance that act on the mosaic, both on when it is switched on"
    GAMMA_LOCKED = "such a gamma that cannot be switched off"
    LATCHED_TIME = "a PtpStatus of when PtpDataSetLatch was last given"
    NOT_IMPLEMENTED = "an ExposureTime whose register is not implemented, and ExposureTimeAbs that works"
    FOLDER_FIRST = "a description in a folder of its archive"
    NO_WRITE_MEMORY = "no WRITEMEM"
    PENDING = "answers to writes only after it has asked for more time"
    NO_TEST_PACKET = "no test packets"
    REVERSED = "packets in the opposite order"
    DOUBLED = "every packet twice"
    PADDED = "a last packet of full size"
    NO_STAMP = "frames without a time stamp"
    MISNUMBERED = "packets sent again that bring others under numbers that have come (issue 311 of Aravis)"
    NO_TRAILER_AGAIN = "a trailer that is lost and, asked for again, refused (issue 813 of Aravis)"
    EVENTS = "events sent to where it is controlled from, with the numbers of its host's requests"
    FEWER_ROWS = "frames of variable height, which end after half of the rows that their leader announces"


def altered(description: str, quirks: Container[Quirk], registers: Mapping[str, int]) -> str:
    """The description of a camera with these quirks. registers: addresses of what only they have."""
    edits: list[tuple[str, str]] = []
    black = '<Float Name="BlackLevel"><pValue>BlackLevelReg</pValue><Unit>DN</Unit></Float>'
    gain = '<Float Name="Gain"><pValue>GainConverter</pValue><Unit>dB</Unit></Float>'
    time = '<Float Name="ExposureTime"><pValue>ExposureTimeReg</pValue>'
    if Quirk.PERCENT_BLACK in quirks:
        percent = (
            '<Float Name="BlackLevel"><pValue>BlackPercent</pValue><Unit>%</Unit></Float>'
            '<SwissKnife Name="BlackPercent"><pVariable Name="DN">BlackLevelReg</pVariable>'
            '<pVariable Name="MOST">PixelDynamicRangeMax</pVariable><Formula>100 * DN / MOST</Formula>'
            "</SwissKnife>"
        )
        edits.append((black, percent))
    if Quirk.NO_UNITS in quirks:
        edits += [
            (one, one.replace("<Unit>DN</Unit>", "").replace("<Unit>dB</Unit>", "")) for one in (black, gain)
        ]
    if Quirk.GAIN_FACTOR in quirks:
        edits += [
            (gain, gain.replace("dB", "x")),
            ("1000 * (10 ** (FROM / 20))", "1000 * FROM"),
            ("20 * LG(TO / 1000)", "TO / 1000"),
        ]
    if Quirk.SECONDS in quirks:
        seconds = (
            '<Float Name="ExposureTime"><pValue>ExposureSeconds</pValue><Unit>s</Unit></Float>'
            '<Converter Name="ExposureSeconds"><FormulaTo>1000000 * FROM</FormulaTo>'
            "<FormulaFrom>TO / 1000000</FormulaFrom><pValue>ExposureMicroseconds</pValue></Converter>"
        )
        edits.append((time, seconds + time.replace('"ExposureTime"', '"ExposureMicroseconds"')))
    if Quirk.NOT_IMPLEMENTED in quirks:
        missing = (
            '<Float Name="ExposureTime"><pValue>ExposureMissingReg</pValue><Unit>us</Unit></Float>'
            '<FloatReg Name="ExposureMissingReg"><pIsImplemented>Never</pIsImplemented>'
            "<Address>0xff000000</Address><Length>8</Length><AccessMode>RW</AccessMode><pPort>Device</pPort>"
            "<Endianess>LittleEndian</Endianess></FloatReg>"
            '<Integer Name="Never"><Value>0</Value></Integer>'
        )
        edits.append((time, missing + time.replace('"ExposureTime"', '"ExposureTimeAbs"')))
    if Quirk.NO_EXPOSURE_CHUNK in quirks:
        chunk = '<Float Name="ChunkExposureTime"><pValue>ChunkExposureTimeReg</pValue>'
        edits += [
            ('<EnumEntry Name="ExposureTime"><Value>1</Value></EnumEntry>', _entry("Image", 1)),
            (chunk, chunk.replace("<pValue>", "<pIsAvailable>ChunkExposureTimeReg</pIsAvailable><pValue>")),
        ]
    for before, after in edits:
        assert description.count(before) == 1, before
        description = description.replace(before, after)
    return description.replace("</RegisterDescription>", _more(quirks, registers) + "</RegisterDescription>")


def _more(quirks: Container[Quirk], registers: Mapping[str, int]) -> str:
    parts = []
    if Quirk.GAMMA in quirks:
        parts += [
            xml.boolean("GammaEnable", registers["gamma"]),
            xml.enumeration("BalanceRatioSelector", registers["balance selector"], {"Red": 0, "Blue": 1}),
            '<Float Name="BalanceRatio"><pValue>BalanceConverter</pValue><Min>0.25</Min><Max>4</Max></Float>'
            '<Converter Name="BalanceConverter"><FormulaTo>1000 * FROM</FormulaTo><FormulaFrom>TO / 1000'
            "</FormulaFrom><pValue>BalanceRatioReg</pValue></Converter>",
            xml.register(
                "IntReg", "BalanceRatioReg", registers["balance"], index=("BalanceRatioSelectorReg", 4)
            ),
        ]
    if Quirk.GAMMA_LOCKED in quirks:
        parts.append(
            '<Float Name="Gamma"><ImposedAccessMode>RO</ImposedAccessMode><Value>0.8</Value></Float>'
        )
    if Quirk.LATCHED_TIME in quirks:
        parts.append(xml.command("PtpDataSetLatch", registers["time latch"]))
    return "\n".join(parts)


def _entry(name: str, value: int) -> str:
    return f'<EnumEntry Name="{name}"><Value>{value}</Value></EnumEntry>'


def in_folder(archive: bytes) -> bytes:
    """The same archive, with its file in a folder that comes first."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(archive)) as plain, zipfile.ZipFile(buffer, "w") as other:
        other.writestr(zipfile.ZipInfo("xml/", (2026, 1, 1, 0, 0, 0)), b"")
        for one in plain.infolist():
            other.writestr(zipfile.ZipInfo(f"xml/{one.filename}", one.date_time), plain.read(one))
    return buffer.getvalue()
