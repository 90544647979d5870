"""Still, machine vision and somebody else's cameras on two nodes: the rig of docs/nodes.md, in real time."""

import re
from contextlib import ExitStack, closing
from pathlib import Path

from capture.check.check import check
from capture.connected_rig import Unattended
from capture.nodes.node import Node
from capture.nodes.node_settings import NodeSettings, place_of
from capture.record.shooting import shoot
from capture.request import CaptureRequest
from capture.rig_of_nodes import assignments_of, nodes_source
from capture.rigfile.rigfile import read_rig_file
from drivers.clock import SystemClock
from drivers.sim.bus_rig import VISION
from imaging.session.session import Session
from tests.capture.nodes.nearby import NearLink
from tests.drivers.gige.fakes import viva_fake

PAGE = Path(__file__).parents[3] / "docs" / "nodes.md"
PROFILES = {"left": "generic", "right": VISION}


def test_the_rig_of_the_page_is_shot(tmp_path: Path) -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    path = tmp_path / "RIG.toml"
    with viva_fake() as fake, ExitStack() as stack:
        text = block.replace("192.168.7.20", fake.ip).replace('"GV01"', '"FAKE-001"')
        path.write_text(text.replace("frames = 6", "frames = 1"))
        rig, request, links = read_rig_file(path), CaptureRequest(), {}
        for name, assignment in assignments_of(rig).items():
            settings = NodeSettings(
                name=name, disk=tmp_path / name, sim="toy", profile=PROFILES[name], changes={"samples": 1}
            )
            place = place_of(settings)
            links[name] = NearLink(lambda place=place, to_do=assignment: Node(place, to_do), place.clock)  # type: ignore[misc]
            stack.enter_context(closing(links[name]))
        with nodes_source(rig, request, links, person=Unattended(), clock=SystemClock()) as source:
            assert source.positions is None  # the fake is moved by nobody that we know
            result = shoot(source, tmp_path / "S", request)
    assert (result.taken, result.missing) == (9, ())
    assert check(tmp_path / "S").sound == 9
    session = Session.open(tmp_path / "S")
    assert [camera.make for camera in session.record.cameras] == ["hdr-rig", "viva-genicam", "hdr-rig"]
    assert {(shot.camera, shot.node) for shot in session.shots()} == {
        ("still", "left"),
        ("fake", "left"),
        ("vision", "right"),
    }
