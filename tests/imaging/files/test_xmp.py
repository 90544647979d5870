"""What drones say in XMP, in both forms that a packet may have, and what is not theirs."""

import struct

import numpy as np
import pytest

from imaging.files.photo import encode_jpeg, read_metadata
from imaging.files.xmp import MARK, drone_note
from imaging.mosaic import FrameMetadata, GpsPosition

ELEMENTS = b"""<rdf:Description xmlns:drone-dji='http://www.dji.com/drone-dji/1.0/'>
<drone-dji:RelativeAltitude>+39.80</drone-dji:RelativeAltitude>
<drone-dji:GimbalPitchDegree>-89.90</drone-dji:GimbalPitchDegree>
<drone-dji:GimbalRollDegree>+0.00</drone-dji:GimbalRollDegree>
<drone-dji:GimbalYawDegree>+45.00</drone-dji:GimbalYawDegree></rdf:Description>"""
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
    found = read_metadata(path)
    assert found.gimbal == (45.0, -89.9, 0.0)
    assert found.height == 39.8
    assert found.position is not None
    assert found.position.altitude == 198.0
    assert (found.position.error, found.position.altitude_error) == (0.015, 0.03)
    path.write_bytes(plain)
    assert read_metadata(path).gimbal is None
    assert read_metadata(path).position == GpsPosition(46.8, -92.0, 198.0, 3.0)
