"""Descriptions that make no sense, or are not safe to read, end in our errors."""

import pytest

from drivers.errors import CameraProtocol
from drivers.genicam.nodemap import NodeMap

from .nodes import Bytes, node_map


@pytest.mark.parametrize(
    "inside",
    [
        '<Integer Name="X"><pValue>X</pValue></Integer>',
        '<Integer Name="X"><pValue>Y</pValue></Integer><Integer Name="Y"><pValue>X</pValue></Integer>',
        '<SwissKnife Name="X"><pVariable Name="A">X</pVariable><Formula>A</Formula></SwissKnife>',
        '<SwissKnife Name="X"><Expression Name="A">B</Expression><Expression Name="B">A</Expression>'
        "<Formula>A</Formula></SwissKnife>",
        '<IntReg Name="X"><pAddress>X</pAddress><Length>4</Length><pPort>Device</pPort></IntReg>',
        '<IntReg Name="X"><Address>0</Address><Length>0</Length><pPort>Device</pPort></IntReg>',
        '<IntReg Name="X"><Address>12z</Address><Length>4</Length><pPort>Device</pPort></IntReg>',
        '<MaskedIntReg Name="X"><Address>0</Address><Length>1</Length><LSB>9</LSB><MSB>1</MSB>'
        "</MaskedIntReg>",
        '<FloatReg Name="X"><Address>0</Address><Length>3</Length><pPort>Device</pPort></FloatReg>',
        '<SwissKnife Name="X"/>',
        '<Integer Name="X"/>',
        '<Converter Name="X"><FormulaTo>FROM</FormulaTo><FormulaFrom>TO</FormulaFrom></Converter>',
        '<Category Name="X"><pFeature>X</pFeature></Category>',
    ],
)
def test_senseless_nodes_end_in_our_error(inside: str) -> None:
    nodes = node_map(inside)
    assert nodes.features("X") in (("X",), ())
    with pytest.raises(CameraProtocol, match="X"):
        nodes.number("X")


@pytest.mark.parametrize(
    "xml",
    [
        b"",
        b"<a>",
        b"<Other/>",
        b"\xff\xfe\x00",
        b'<?xml version="1.0" encoding="klingon"?><RegisterDescription/>',
        b'<!DOCTYPE x [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><RegisterDescription>&b;</RegisterDescription>',
        b'<!DOCTYPE x SYSTEM "file:///etc/passwd"><RegisterDescription/>',
        b"<RegisterDescription>" + b"<a>" * 1000 + b"</a>" * 1000 + b"</RegisterDescription>",
        b"<RegisterDescription>&undefined;</RegisterDescription>",
    ],
)
def test_unsafe_or_broken_xml_is_refused(xml: bytes) -> None:
    with pytest.raises(CameraProtocol, match="the description"):
        NodeMap(xml, Bytes(), "the camera")
