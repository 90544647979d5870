"""Nodes on a Ray cluster of one machine: each is a raylet with processes of its own."""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from capture.capture_rig import capture_rig
from capture.check.check import check
from capture.connected_rig import Unattended
from capture.nodes.cluster import RayLink, ray_links, resource_of
from capture.nodes.joining import joined_as
from capture.nodes.node import Assignment
from capture.nodes.node_settings import VARIABLE, NodeSettings
from capture.record.capture_result import CaptureResult
from capture.record.shooting import shoot
from capture.request import CaptureRequest
from capture.rig_of_nodes import assignments_of, nodes_source
from capture.rigfile.rigfile import RigFile, read_rig_file
from drivers.errors import HostLost
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from imaging.errors import CaptureError, InputError
from imaging.session.session import Session
from tests.trees import tree

pytest.importorskip("ray")
NODES = ("left", "right")
RIG = """
frames = 3
[bracket]
exposures = [0]
time = "1/60"
f_number = 8
"""
CAMERAS = [
    f'\n[[camera]]\nname = "cam{n}"\nserial = "SIM-RAW-{n + 1:03d}"\nrig = "rig"\nnode = "{NODES[n % 2]}"\n'
    for n in range(4)
]


@dataclass
class Hosts:
    """A cluster, and the nodes of it that are up."""

    cluster: Any
    folder: Path
    up: dict[str, Any] = field(default_factory=dict)
    links: dict[str, RayLink] = field(default_factory=dict)

    @property
    def address(self) -> str:
        return str(self.cluster.address)

    def start(self, name: str) -> None:
        settings = NodeSettings(
            name=name, disk=self.folder / name, sim="toy", seed=3, changes={"cameras": 4, "samples": 1}
        )
        self.up[name] = self.cluster.add_node(
            num_cpus=1,
            object_store_memory=80_000_000,
            resources={resource_of(name): 1},
            env_vars={VARIABLE: settings.model_dump_json()},
        )

    def switch_off(self, name: str) -> None:
        """Stop as if its mains were pulled."""
        os.kill(_pid(self.links[name]), signal.SIGKILL)
        self.cluster.remove_node(self.up.pop(name), allow_graceful=False)

    def rig(self) -> RigFile:
        path = self.folder / "RIG.toml"
        path.write_text(RIG + "".join(CAMERAS))
        return read_rig_file(path)

    def shoot(self, out: Path, said: list[str], resume: bool = False, **watch: Any) -> CaptureResult:
        rig, request = self.rig(), CaptureRequest(resume=resume)
        with (
            ray_links(self.address, assignments_of(rig)) as links,
            nodes_source(rig, request, links, person=Unattended(), say=said.append) as source,
        ):
            self.links = links
            return shoot(source, out, request, **watch)


@pytest.fixture(scope="module")
def hosts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hosts]:
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        here = str(Path(__file__).parents[3])
        patch.setenv("PYTHONPATH", os.pathsep.join([here, *filter(None, sys.path)]))
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("RAY_AUTH_TOKEN_PATH", str(tmp_path_factory.mktemp("ray") / "auth_token"))
        cluster = Cluster(
            initialize_head=True,
            head_node_args={
                "num_cpus": 1,
                "include_dashboard": False,
                "object_store_memory": 80_000_000,
            },
        )
        hosts = Hosts(cluster, tmp_path_factory.mktemp("hosts"))
        try:
            for name in NODES:
                hosts.start(name)
            yield hosts
        finally:
            cluster.shutdown()


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of the same session, shot by one host."""
    folder = tmp_path_factory.mktemp("alone")
    (folder / "RIG.toml").write_text(RIG + "".join(CAMERAS))
    rig = simulate("toy", 3, samples=1, cameras=4)
    bus = BusRig(rig)
    file = read_rig_file(folder / "RIG.toml")
    capture_rig(file, folder / "S", operator=rig, positions=rig.frames, backend=bus.backend, clock=bus.clock)
    return tree(folder / "S", "*.dng")


def test_a_session_over_processes_is_the_one_of_one_host(
    hosts: Hosts, alone: dict[str, bytes], tmp_path: Path
) -> None:
    said: list[str] = []
    result = capture_rig(hosts.rig(), tmp_path / "S", ray=hosts.address, on_message=said.append)
    assert (result.taken, result.missing, said) == (12, (), [])
    assert tree(tmp_path / "S", "*.dng") == alone
    assert check(tmp_path / "S").sound == 12
    for shot in Session.open(tmp_path / "S").shots():
        assert shot.node == NODES[int(shot.camera[-1]) % 2]
        # All processes of a machine have one monotonic clock: the true offset is 0.
        assert abs(shot.clock_offset or 0.0) <= (shot.clock_error or 0.0)


def test_a_node_that_is_switched_off_costs_its_frames_and_is_made_up_for(
    hosts: Hosts, alone: dict[str, bytes], tmp_path: Path
) -> None:
    said: list[str] = []

    def switch_off(message: str, done: int, total: int) -> None:
        if done == 8 and "right" in hosts.up:
            hosts.switch_off("right")

    result = hosts.shoot(tmp_path / "S", said, progress=switch_off)
    (line,) = said
    assert line.startswith("Node right does not answer, and its cameras get no frames until it is back")
    assert [one.split(":")[0] for one in result.missing] == ["cam1, frame 2, step 0", "cam3, frame 2, step 0"]
    assert check(tmp_path / "S").sound == 12 - len(result.missing)
    hosts.start("right")
    resumed = hosts.shoot(tmp_path / "S", said, resume=True)
    assert (resumed.taken, resumed.missing, len(said)) == (len(result.missing), (), 1)
    assert tree(tmp_path / "S", "*.dng") == alone


def test_an_actor_that_dies_begins_anew(hosts: Hosts) -> None:
    with ray_links(hosts.address, {"left": Assignment(("SIM-RAW-001",))}) as links:
        link = links["left"]
        assert list(link.ask("report").served) == ["SIM-RAW-001"]
        with pytest.raises(CaptureError, match="node left serves another capture"):
            _require_free(hosts)
        os.kill(_pid(link), signal.SIGKILL)
        answers = 0
        while not answers:
            with suppress(HostLost):
                answers = len(link.ask("report").served)


def test_a_cluster_that_lets_everybody_in_is_not_joined(
    hosts: Hosts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(tmp_path / "auth_token"))
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    settings = NodeSettings(name="open", disk=hosts.folder / "open", sim="toy")
    with (
        pytest.raises(
            InputError, match=r"lets any program on its network run code.*RAY_AUTH_MODE=token ray start"
        ),
        joined_as(settings, hosts.address),
    ):
        pass


def test_more_frames_than_a_simulated_rig_has_positions_name_who_asks(hosts: Hosts, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"asks for 7 frames, and the simulated rig of node left has 3 posi"):
        capture_rig(hosts.rig(), tmp_path / "S", frames=7, ray=hosts.address)
    assert not (tmp_path / "S").exists()


def _require_free(hosts: Hosts) -> None:
    from capture.nodes import cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster, "RELEASED", 0.0)
        import ray

        cluster._require_node(ray, hosts.address, "left")


def _pid(link: RayLink) -> int:
    import ray

    return int(ray.get(link._actor.__ray_call__.remote(lambda node: os.getpid())))


def test_what_is_not_there_is_told(hosts: Hosts) -> None:
    with (
        pytest.raises(
            CaptureError, match=r"has no node middle \(it has left, right\): start rig node middle"
        ),
        ray_links(hosts.address, {"middle": Assignment(())}),
    ):
        pass
    with pytest.raises(InputError, match=r"No Ray cluster answers at 127\.0\.0\.1:9 .*ray start --head"):  # noqa: SIM117
        with ray_links("127.0.0.1:9", {"left": Assignment(())}):
            pass
