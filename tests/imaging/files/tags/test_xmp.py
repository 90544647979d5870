"""XMP of drones, in both forms that a packet may have, and foreign packets."""

import struct
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image

from imaging.files.heif_webp import heif_is_read
from imaging.files.photo import encode_jpeg, encode_png, read_metadata, read_photo
from imaging.files.tags.xmp import MARK, drone_note
from imaging.files.tiff.directory import BYTE, UNDEFINED, Entry
from imaging.files.tiff.exif import encode_exif
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata, GpsPosition

ELEMENTS = b"""<rdf:Description xmlns:drone-dji='http://www.dji.com/drone-dji/1.0/'>
<drone-dji:RelativeAltitude>+39.80</drone-dji:RelativeAltitude>
<drone-dji:GimbalPitchDegree>-89.90</drone-dji:GimbalPitchDegree>
<drone-dji:GimbalRollDegree>+0.00</drone-dji:GimbalRollDegree>
<drone-dji:GimbalYawDegree>+45.00</drone-dji:GimbalYawDegree></rdf:Description>"""
PLACED = ELEMENTS.replace(
    b"</rdf",
    b"""<drone-dji:GpsLatitude>+46.8</drone-dji:GpsLatitude><drone-dji:GpsLongtitude>-92.1</drone-dji:GpsLongtitude>
<drone-dji:AbsoluteAltitude>+231.50</drone-dji:AbsoluteAltitude></rdf""",
)
ATTRIBUTES = b"""<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"
 drone-dji:RelativeAltitude="+39.80" drone-dji:GimbalPitchDegree="-89.90" drone-dji:GimbalYawDegree="45"
 drone-dji:RtkFlag="50"
 drone-dji:RtkStdLon="0.012" drone-dji:RtkStdLat="0.015" drone-dji:RtkStdHgt="0.03"/>"""


@pytest.mark.parametrize("packet", [ELEMENTS, ATTRIBUTES])
def test_attitude_and_height_are_read_from_elements_and_from_attributes(packet):
    note = drone_note(packet)
    assert note.gimbal == (45.0, -89.9, 0.0)
    assert note.height == 39.8


def test_a_corrected_position_states_its_errors_and_another_does_not():
    assert (drone_note(ATTRIBUTES).error, drone_note(ATTRIBUTES).altitude_error) == (0.015, 0.03)
    single = drone_note(ATTRIBUTES.replace(b'"50"', b'"16"'))
    assert (single.error, single.altitude_error) == (None, None)


@pytest.mark.parametrize(
    "packet",
    [
        b"",
        b"<x:xmpmeta>no drone</x:xmpmeta>",
        ELEMENTS.replace(b"-89.90", b"many").replace(b"39.80", b"1e999"),
        ELEMENTS.replace(b"-89.90", b"-8990").replace(b"+39.80", b"9999999"),
    ],
)
def test_what_is_damaged_or_no_drones_tells_nothing(packet):
    assert drone_note(packet).gimbal is None
    assert drone_note(packet).height is None


def test_a_photograph_says_what_its_packet_says(tmp_path):
    plain = encode_jpeg(
        np.zeros((8, 8, 3), np.uint8), metadata=FrameMetadata(position=GpsPosition(46.8, -92.0, 198.0, 3.0))
    )
    body = MARK + ATTRIBUTES
    segment = b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body
    path = tmp_path / "drone.jpg"
    path.write_bytes(plain[:2] + segment + plain[2:])
    metadata = read_metadata(path)
    assert metadata.gimbal == (45.0, -89.9, 0.0)
    assert metadata.height == 39.8
    assert metadata.position is not None
    assert metadata.position.altitude == 198.0
    assert (metadata.position.error, metadata.position.altitude_error) == (0.015, 0.03)
    path.write_bytes(plain)
    assert read_metadata(path).gimbal is None
    assert read_metadata(path).position == GpsPosition(46.8, -92.0, 198.0, 3.0)


SAID = FrameMetadata(make="DJI", exposure=Exposure(time=0.01), position=GpsPosition(46.8, -92.0, 198.0, 3.0))


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def holding(path, kind, packet, said=None):
    """A file of 64 x 96 pixels with an XMP packet, and EXIF where there is some."""
    pixels = np.full((64, 96, 3), 90, np.uint8)
    exif = encode_exif(said) if said is not None else None
    if kind == "tif":
        tags = [(700, 1, len(packet), packet, True)] if packet else []
        tifffile.imwrite(path, pixels, photometric="rgb", metadata=None, extratags=tags)
    elif kind.startswith("png"):
        head, text = b"XML:com.adobe.xmp\0", packet
        if kind == "png packed":
            head, text = head + b"\1\0", zlib.compress(packet)
        else:
            head += b"\0\0"
        plain = encode_png(pixels)
        extra = chunk(b"iTXt", b"Comment\0\0\0\0\0none") + chunk(b"iTXt", head + b"\0\0" + text)
        extra += chunk(b"eXIf", exif.removeprefix(b"Exif\0\0")) if exif else b""
        path.write_bytes(plain[:33] + extra + plain[33:])
    else:
        if kind == "heif":
            import pillow_heif

            pillow_heif.register_heif_opener()
        more = {"exif": exif} if exif else {}
        Image.fromarray(pixels).save(path, kind.upper(), xmp=packet, **more)
    return path


KINDS = [
    "tif",
    "png",
    "png packed",
    "webp",
    "jpeg",
    pytest.param("heif", marks=pytest.mark.skipif(not heif_is_read(), reason="pillow-heif is not installed")),
]


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_photograph_says_it(tmp_path, kind):
    path = holding(tmp_path / "a.x", kind, PLACED)
    for metadata in (read_metadata(path), read_photo(path).metadata):
        assert (metadata.gimbal, metadata.height) == ((45.0, -89.9, 0.0), 39.8)
        assert metadata.position == GpsPosition(46.8, -92.1, 231.5)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "tif"])
def test_the_place_of_exif_counts_before_that_of_the_packet(tmp_path, kind):
    metadata = read_metadata(holding(tmp_path / "a.x", kind, PLACED, SAID))
    assert metadata.make == "DJI"
    assert metadata.position == SAID.position
    assert metadata.height == 39.8
    corrected = read_metadata(holding(tmp_path / "a.x", kind, ATTRIBUTES, SAID)).position
    assert corrected == GpsPosition(46.8, -92.0, 198.0, 0.015, 0.03)


@pytest.mark.parametrize("entry", [Entry(BYTE, list(PLACED)), Entry(UNDEFINED, PLACED)])
def test_a_dng_says_it_too(write, monkeypatch, entry):
    monkeypatch.setattr("imaging.files.tiff.dng_tags.BASELINE_NOISE", 700)
    metadata = read_metadata(write(BASELINE_NOISE=entry))
    assert (metadata.gimbal, metadata.height) == ((45.0, -89.9, 0.0), 39.8)
    assert metadata.position == GpsPosition(46.8, -92.1, 231.5)


@pytest.mark.parametrize("latitude", [b"0", b"+91.0", b"north"])
def test_a_place_that_cannot_be_is_none(latitude):
    assert drone_note(PLACED).position == GpsPosition(46.8, -92.1, 231.5)
    assert drone_note(PLACED.replace(b"+46.8", latitude)).position is None


def test_a_damaged_text_of_a_png_is_no_packet(tmp_path):
    path = holding(tmp_path / "a.png", "png packed", PLACED)
    data = bytearray(path.read_bytes())
    at = data.index(b"com.adobe.xmp") + 20
    data[at : at + 4] = b"\xff\xff\xff\xff"
    path.write_bytes(bytes(data))
    assert read_metadata(path) == FrameMetadata()
