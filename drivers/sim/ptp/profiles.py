"""The cameras that a PTP responder can pass for, as data.

Names, vendor numbers and lists are those of real bodies, as libgphoto2 and its dumps of cameras have
them; what is behind is always the simulated sensor. Verified against: gphoto2 over PTP/IP; no hardware.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Literal

from drivers.ptp.protocol.codes import FormatCode, NikonEvent, SonyEvent, VendorId
from drivers.sim.ptp import dials as dials
from drivers.sim.ptp.dials import SimulatedDial
from imaging.errors import InputError


class Style(Enum):
    """Maker's protocol for remote shooting."""

    STANDARD = "standard"
    CANON = "canon"
    NIKON = "nikon"
    SONY = "sony"


@dataclass(frozen=True)
class CameraProfile:
    """A model of camera.

    vendor, product: of the USB descriptor; extension: DeviceInfo's vendor id; raw_format: of its RAW objects;
    prefix: of file names; jpeg_settings, raw_setting, raw_jpeg_settings: the values of CompressionSetting for
    JPEG, RAW or both; jpeg: whether both are selected; write: seconds from the end of an exposure until the
    file is on the card; lag: from the order to the exposure; rate: frames a second in a burst; records: the
    record layout in which a Canon announces files, by the bits of their sizes.
    """

    name: str
    style: Style
    maker: str
    model: str
    vendor: int
    product: int
    extension: int
    extension_version: int
    extension_text: str
    dials: tuple[SimulatedDial, ...]
    events: tuple[int, ...] = ()
    raw_format: int = FormatCode.DNG
    prefix: str = "IMG_"
    folder: str = "100HDRIG"
    jpeg_settings: tuple[int, ...] = (0, 1, 2)
    raw_setting: int = 4
    raw_jpeg_settings: tuple[int, ...] = (5, 6, 7)
    write: float = 0.15
    jpeg: bool = False
    lag: float = 0.0
    rate: float = 10.0
    records: Literal["32", "64", "64 long names"] = "32"


PROFILES = {
    profile.name: profile
    for profile in (
        CameraProfile(
            "generic",
            Style.STANDARD,
            "hdr-rig",
            "Simulated PTP",
            0x1209,
            0x0001,
            0xFFFFFFFF,
            0,
            "",
            (dials.EXPOSURE_TIME, dials.F_NUMBER, dials.EXPOSURE_INDEX),
        ),
        CameraProfile(
            "canon-eos-6d",
            Style.CANON,
            "Canon Inc.",
            "Canon EOS 6D",
            0x04A9,
            0x3250,
            VendorId.CANON,
            100,
            "",
            (dials.CANON_TIME, dials.CANON_F_NUMBER, dials.CANON_ISO),
            raw_format=FormatCode.VENDOR_RAW_2,
            folder="100CANON",
            rate=4.5,
        ),
        CameraProfile(
            "canon-eos-r7",
            Style.CANON,
            "Canon.Inc",
            "Canon EOS R7",
            0x04A9,
            0x32F7,
            VendorId.CANON,
            100,
            "",
            (dials.CANON_TIME, dials.CANON_F_NUMBER, dials.CANON_ISO),
            raw_format=FormatCode.CANON_CR3,
            folder="100CANON",
            rate=15.0,
            records="64",
        ),
        CameraProfile(
            "nikon-z6",
            Style.NIKON,
            "Nikon Corporation",
            "Z 6",
            0x04B0,
            0x0443,
            VendorId.NIKON,
            110,
            "Microsoft.com/DeviceServices: 1.0",
            (dials.NIKON_TIME, dials.EXPOSURE_TIME, dials.F_NUMBER, dials.EXPOSURE_INDEX, dials.NIKON_ISO),
            events=tuple(NikonEvent),
            raw_format=FormatCode.UNDEFINED,
            prefix="DSC_",
            folder="100NCZ_6",
            rate=5.5,
            jpeg_settings=(0, 1, 2, 3, 4, 5, 6),
            raw_setting=7,
            raw_jpeg_settings=(8, 9, 10, 11, 12, 13),
        ),
        CameraProfile(
            "sony-a7m4",
            Style.SONY,
            "Sony Corporation",
            "ILCE-7M4",
            0x054C,
            0x0DA7,
            VendorId.SONY,
            100,
            "Sony PTP Extensions",
            (dials.SONY_TIME, dials.F_NUMBER, dials.SONY_ISO),
            events=tuple(SonyEvent),
            raw_format=FormatCode.VENDOR_RAW_1,
            prefix="DSC0",
            folder="100MSDCF",
            jpeg_settings=(1, 2, 3, 4),
            raw_setting=0x10,
            raw_jpeg_settings=(0x11, 0x12, 0x13, 0x14),
        ),
    )
}


def profile(name: str) -> CameraProfile:
    """Look up a profile by name; InputError for an unknown one, with the list of names."""
    if name not in PROFILES:
        raise InputError(f"there is no profile {name!r}: choose one of {', '.join(PROFILES)}.")
    return PROFILES[name]
