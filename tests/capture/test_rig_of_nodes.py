"""A rig on several hosts: the session is the one that one host would have shot."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from capture.check.check import check
from capture.connected_rig import Unattended
from capture.nodes.node import Assignment
from capture.request import CaptureRequest
from capture.rig_of_nodes import assignments_of, nodes_source
from capture.rigfile.rigfile import read_rig_file
from drivers.sim.bus_rig import VISION
from drivers.sim.faults import ROUGH
from drivers.sim.genicam.lines import Wire
from drivers.sim.jumping_clock import JumpingClock
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import CaptureError, InputError, StorageError
from imaging.files import store
from imaging.session.session import Session
from tests.capture.nodes.nearby import near_node
from tests.capture.nodes.place import NODES, RIG, Place


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    place = Place(tmp_path)
    yield place
    remaining = [path for name in NODES for path in (tmp_path / name).glob("*")]
    assert not remaining, "frames stay on a node that has given them away"


@pytest.mark.parametrize("model", ["generic", "nikon-z6", VISION])
def test_the_session_is_the_one_that_one_host_would_have_shot(place: Place, model: str) -> None:
    place.model = model
    assert place.shoot_without_nodes().missing == ()
    result = place.shoot()
    assert (result.taken, result.missing, result.problems, place.said) == (8, (), (), [])
    assert place.files("nodes") == place.files("alone")
    assert len(place.files("nodes")) == 8
    alone, nodes = (Session.open(place.folder / name) for name in ("alone", "nodes"))
    assert alone.record.cameras == nodes.record.cameras
    assert [shot.sha256 for shot in alone.shots()] == [shot.sha256 for shot in nodes.shots()]
    assert check(place.folder / "nodes").sound == 8


def test_what_is_metered_and_planned_is_the_same_too(place: Place) -> None:
    place.text = RIG.replace("[-4, 0]", '"auto"').replace('time = "1/60"\n', "snr = 12\n")
    place.text = place.text.replace("frames = 2", "frames = 1")
    place.shoot_without_nodes()
    place.shoot()
    one, other = (Session.open(place.folder / name).plans()[0] for name in ("alone", "nodes"))
    assert one.model_dump(exclude={"created"}) == other.model_dump(exclude={"created"})
    assert place.files("nodes") == place.files("alone")


def test_every_record_has_the_clock_of_its_node_and_shutters_are_compared_on_one(place: Place) -> None:
    place.model = VISION
    place.shoot()
    shots = Session.open(place.folder / "nodes").shots()
    for shot in shots:
        node = "left" if shot.camera == "cam0" else "right"
        assert shot.node == node
        assert shot.clock_offset is not None
        assert shot.clock_error is not None
        assert abs(shot.clock_offset - NODES[node]) <= shot.clock_error < 0.0015
        assert shot.skew is not None
        assert shot.skew < 0.001


def test_shutters_open_together_however_long_a_node_takes_to_be_told(place: Place) -> None:
    """The right node is told 20 ms after the left one; devices say when they opened on the clock of all."""
    place.model, place.ways = VISION, {"right": 0.02}
    opened: dict[str, list[float]] = {}

    def watch(place: Place) -> None:
        for name, link in place.links.items():
            backend: Any = link.node._place.backend
            for serial in assignments_of(place.file)[name].serials:
                opened[serial] = backend.port(serial).device.opened

    place.shoot(prepare=watch)
    assert {len(times) for times in opened.values()} == {4}
    assert np.ptp(np.array(list(opened.values())), axis=0).max() < 0.001
    for shot in Session.open(place.folder / "nodes").shots():
        assert (shot.clock_error or 0.0) < 0.021
        assert shot.skew is not None
        assert shot.skew < 0.001


def test_a_clock_that_jumps_is_told_and_what_is_stated_stays_true(place: Place) -> None:
    """Wherever in a session it jumps, and devices say when they opened on the clock of all."""
    place.model = VISION
    place.shoot_without_nodes()
    place.shoot("calm")
    end, jumped = place.clock.now(), 0
    for number, at in enumerate(np.linspace(0.15, end, 8)):
        by = (0.03, -0.03, 0.4, -2.0)[number % 4]
        place.said.clear()
        place.jumps = {"right": [(at, by)]}
        devices: dict[str, Any] = {}

        def watch(place: Place, devices: dict[str, Any] = devices) -> None:
            for name, link in place.links.items():
                backend: Any = link.node._place.backend
                (serial,) = assignments_of(place.file)[name].serials
                devices[name] = backend.port(serial).device

        out = f"jump{number}"
        result = place.shoot(out, prepare=watch)
        assert (result.taken, result.missing) == (8, ())
        assert place.files(out) == place.files("alone")
        clock = JumpingClock(place.clock, NODES["right"], [(at, by)])
        shots = Session.open(place.folder / out).shots()
        opened = {name: sorted(device.opened) for name, device in devices.items()}
        for node in NODES:
            mine = sorted(
                (shot for shot in shots if shot.node == node), key=lambda one: (one.frame, one.step)
            )
            others = opened["left" if node == "right" else "right"]
            for shot, moment, other in zip(mine, opened[node], others, strict=True):
                true = clock.ahead_at(moment) if node == "right" else NODES["left"]
                assert abs(shot.clock_offset - true) <= shot.clock_error
                late = max(0.0, moment - other)
                if shot.skew is None:
                    jumped += 1
                    assert shot.skew_bound is not None
                    assert shot.skew_bound >= late
                else:
                    assert abs(shot.skew - late) <= 0.003
        named = [line for line in place.said if line.startswith("The clock of node right jumped by")]
        assert named == place.said
        assert len(named) <= 1
        assert not named or float(re.search(r"by (\S+) s", named[0]).group(1)) == pytest.approx(by, abs=0.005)
        assert named or at > max(opened["right"])  # nobody asks after the last shot
    assert 0 < jumped < 16  # of 64 shots, most of which no clock jumped beside


@pytest.mark.parametrize("dies_at", [("arm", 3), ("trigger", 4), ("keep", 3), ("store", 2), ("read", 3)])
def test_a_node_that_is_lost_costs_its_frames_and_a_sentence(place: Place, dies_at: tuple[str, int]) -> None:
    def die(place: Place) -> None:
        place.links["right"].dies_at = dies_at

    place.shoot_without_nodes()
    result = place.shoot(prepare=die)
    (line,) = place.said
    assert line.startswith("Node right does not answer, and its cameras get no frames until it is back:")
    assert result.missing
    assert {one.split(",")[0] for one in result.missing} == {"cam1"}
    there = [name for name in place.files("nodes") if "cam0" in name]
    assert len(there) == 4
    place.said.clear()
    for link in place.links.values():
        link.start_again()  # what is left on its disk is removed when it begins
    resumed = place.shoot(resume=True)
    assert (resumed.earlier, resumed.taken, resumed.missing) == (
        8 - len(result.missing),
        len(result.missing),
        (),
    )
    assert place.files("nodes") == place.files("alone")


def test_a_node_that_comes_back_is_shot_with_again(place: Place) -> None:
    """It misses more shots in a row than a camera may that fails by itself, and nobody waits for it."""
    place.text = RIG.replace("frames = 2", "frames = 3").replace("[-4, 0]", "[-6, -5, -4, 0]")
    place.text = place.text.replace('"1/60"', '"2"')
    place.shoot_without_nodes()
    place.shoot("calm")
    calm = place.clock.now()

    def blink(place: Place) -> None:
        link = place.links["right"]
        link.dies_at = ("trigger", 2)
        place.clock.call_later(calm / 3, link.start_again)

    result = place.shoot(prepare=blink)
    assert [line.split(",")[0] for line in place.said] == ["Node right does not answer", "Node right is back"]
    frames = {one.split(":")[0].rpartition(",")[0] for one in result.missing}
    assert frames == {"cam1, frame 0"}
    assert place.clock.now() < 4 / 3 * calm + 0.1  # what it missed of frame 1 is taken once more
    whole = place.files("alone")
    there = place.files("nodes")
    assert len(there) == len(whole) - len(result.missing)
    assert there.items() <= whole.items()
    assert place.shoot(resume=True).missing == ()
    assert place.files("nodes") == whole
    shots = Session.open(place.folder / "nodes").shots()
    assert len({shot.identity for shot in shots}) == len(shots) == len(whole)


def test_a_frame_that_is_damaged_on_the_way_is_fetched_again(place: Place) -> None:
    def damage(place: Place) -> None:
        place.links["left"].damaged = 1

    place.shoot_without_nodes()
    result = place.shoot(prepare=damage)
    assert result.missing == ()
    assert check(place.folder / "nodes").sound == 8


def test_faults_on_the_buses_of_nodes_cost_nothing(place: Place) -> None:
    place.options = {"mix": ROUGH}
    result = place.shoot()
    assert (result.taken, result.missing) == (8, ())
    assert check(place.folder / "nodes").sound == 8


def test_a_node_removes_its_own_leftovers_and_nothing_else_of_its_disk(tmp_path: Path) -> None:
    disk = tmp_path / "near"
    leftovers = ("shot-000012-0a1b2c3d.dng", ".shot-1000000-0a1b2c3d.jpg.part")
    foreign = ("shot-list.txt", "shot-001.nef", "shot-000012-0a1b2c3d.dng.bak", "a shot-000012-0a1b2c3d.dng")
    (disk / "shot-day1").mkdir(parents=True)
    (disk / "shot-000001-0a1b2c3d.d").mkdir()
    for name in (*leftovers, *foreign, "shot-day1/a.nef"):
        (disk / name).touch()
    near_node("near", Assignment(serials=()), VirtualClock(), tmp_path).ask("report")
    assert {path.name for path in disk.iterdir()} == {"shot-day1", "shot-000001-0a1b2c3d.d", *foreign}
    assert (disk / "shot-day1" / "a.nef").exists()


def test_the_disk_of_a_node_that_is_full_is_told(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    write = store.write_pieces

    def refuse(path: Path, pieces: Any) -> None:
        if path.parent.name == "left":
            raise StorageError(f"{path} could not be written (no space left on device): free some space.")
        write(path, pieces)

    monkeypatch.setattr(store, "write_pieces", refuse)
    result = place.shoot()
    assert {one.split(",")[0] for one in result.missing} == {"cam0"}
    assert "the disk of node left is in the way" in result.missing[0]


def test_a_camera_that_is_at_another_node_is_named_with_its_line(place: Place) -> None:
    text = place.file.path.read_text().replace('"SIM-RAW-002"', '"SIM-RAW-009"')
    place.text, place.cameras = text, 0
    clock = VirtualClock()
    (place.folder / "RIG.toml").write_text(text)
    rig = read_rig_file(place.folder / "RIG.toml")
    links = {
        name: near_node(name, assignment, clock, place.folder, cameras=2)
        for name, assignment in assignments_of(rig).items()
    }
    with (
        pytest.raises(CaptureError, match=r"cam1 with the serial number 'SIM-RAW-009' is not among"),
        nodes_source(rig, CaptureRequest(), links, person=Unattended(), clock=clock),
    ):
        pass
    for link in links.values():
        link.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('node = "left"\n\n', "\n\n"), "cam0 names no node, as other cameras do"),
        (('mode = "software"', 'mode = "action"'), "action commands trigger cameras of one host"),
        (('node = "left"', 'node = "a b"'), "has to be made of letters, digits"),
    ],
)
def test_rig_files_that_cannot_be_are_told_with_their_line(
    place: Place, change: tuple[str, str], words: str
) -> None:
    text = place.file.path.read_text()
    assert change[0] in text
    place.file.path.write_text(text.replace(*change, 1))
    with pytest.raises(InputError, match=rf"RIG\.toml, line \d+: .*{words}"):
        read_rig_file(place.folder / "RIG.toml")


def test_a_wire_from_node_to_node_triggers(place: Place) -> None:
    """Line1 of cam0, at the left node, is soldered to Line0 of cam1, at the right one."""
    hardware = 'mode = "hardware"\nline = "Line0"\noutput = "Line1"\nleader = "cam0"'
    place.text = RIG.replace('mode = "software"', hardware)
    opened: list[list[float]] = []

    def solder(place: Place) -> None:
        wire = Wire(place.clock)
        for number, (name, link) in enumerate(place.links.items()):
            backend: Any = link.node._place.backend
            (serial,) = assignments_of(place.file)[name].serials
            wire.connect(backend.port(serial).device, 1 - number)
            opened.append(backend.port(serial).device.opened)

    place.model = VISION
    assert place.shoot(prepare=solder).missing == ()
    assert np.abs(np.subtract(*opened)).max() < 100e-6
    place.model = "generic"
    with pytest.raises(InputError, match=r"line \d+: cam0 has no lines for a hardware trigger"):
        place.shoot("still")
