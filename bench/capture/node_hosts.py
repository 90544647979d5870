"""Hosts of bench.capture.nodes: a cluster on this machine, each node in a network namespace if permitted."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from capture.nodes.joining import PATIENT, joined_as
from capture.nodes.node_settings import VARIABLE, NodeSettings
from capture.nodes.token import MODE
from drivers.sim.bus_rig import VISION

NODES = ("north", "northeast", "east", "southeast", "south", "southwest", "west", "northwest")
PORT, SUBNET, BRIDGE = 6391, "10.77.31", "rigbench"


def model_of(name: str) -> str:
    """Cameras of a node: still and machine vision cameras in turn."""
    return ("generic", VISION)[NODES.index(name) % 2]


@dataclass
class Hosts:
    """The nodes, and the address of the cluster. apart: each in a namespace."""

    folder: Path
    settings: dict[str, Any]
    apart: bool
    address: str
    up: dict[str, "subprocess.Popen[str]"] = field(default_factory=dict)

    def start(self, name: str, **more: Any) -> None:
        """Start a node, and wait until it has joined."""
        settings = NodeSettings(
            name=name, disk=self.folder / name, sim="toy", profile=model_of(name), **self.settings, **more
        )
        command = [sys.executable, "-m", "bench.capture.node_hosts", settings.model_dump_json(), self.address]
        if self.apart:
            command = ["ip", "netns", "exec", _space(name), *command]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        if process.stdout.readline().strip() != "joined":
            raise SystemExit(f"node {name} did not join")
        self.up[name] = process

    def switch_off(self, name: str) -> None:
        """Kill all processes of a node at once."""
        mark = f'{VARIABLE}={{"name":"{name}"'.encode()
        process = self.up.pop(name)
        process.kill()
        for place in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if mark in (place / "environ").read_bytes():
                    os.kill(int(place.name), signal.SIGKILL)
        process.wait()

    def stop(self) -> None:
        """Remove all nodes."""
        for process in self.up.values():
            process.send_signal(signal.SIGINT)
        for process in self.up.values():
            process.wait()
        self.up.clear()


def _space(name: str) -> str:
    return f"{BRIDGE}-{name}"


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


@contextmanager
def namespaces(names: Sequence[str]) -> Iterator[bool]:
    """A network namespace for each node, on a bridge of this host; whether that is permitted."""
    for leftover in [("link", "del", BRIDGE), *(("netns", "del", _space(name)) for name in NODES)]:
        with suppress(OSError, subprocess.CalledProcessError):  # of a run that was killed
            _ip(*leftover)
    with ExitStack() as stack:
        try:
            _ip("link", "add", BRIDGE, "type", "bridge")
            stack.callback(_ip, "link", "del", BRIDGE)
            _ip("addr", "add", f"{SUBNET}.254/24", "dev", BRIDGE)
            _ip("link", "set", BRIDGE, "up")
            for number, name in enumerate(names):
                space, inside, outside = _space(name), f"rign{number}", f"rigb{number}"
                _ip("netns", "add", space)
                stack.callback(_ip, "netns", "del", space)
                _ip("link", "add", outside, "type", "veth", "peer", "name", inside)
                _ip("link", "set", inside, "netns", space)
                _ip("link", "set", outside, "master", BRIDGE, "up")
                _ip("-n", space, "addr", "add", f"{SUBNET}.{number + 1}/24", "dev", inside)
                for link in (inside, "lo"):
                    _ip("-n", space, "link", "set", link, "up")
        except (OSError, subprocess.CalledProcessError):
            stack.close()
            yield False
            return
        yield True


@contextmanager
def cluster(folder: Path, names: Sequence[str], settings: dict[str, Any]) -> Iterator[Hosts]:
    """A head on this host, no node yet."""
    os.environ[MODE] = "disabled"  # the network is that of the nodes alone
    with namespaces(names) as apart:
        host = f"{SUBNET}.254" if apart else "127.0.0.1"
        command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", "--block"]
        command += ["--port", str(PORT), "--node-ip-address", host, "--num-cpus", "1"]
        command += ["--include-dashboard", "False", "--disable-usage-stats"]
        head = subprocess.Popen(
            command, env=PATIENT | os.environ, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        assert head.stdout is not None
        while "Ray runtime started" not in (line := head.stdout.readline()):
            if not line:
                raise SystemExit("ray start --head failed: ray stop ends one that is left over")
        hosts = Hosts(folder, settings, apart, f"{host}:{PORT}")
        try:
            yield hosts
        finally:
            hosts.stop()
            head.terminate()
            head.wait()


def serve(settings: str, address: str) -> None:
    """A node, until it is interrupted."""
    with joined_as(NodeSettings.model_validate_json(settings), address) as node, suppress(KeyboardInterrupt):
        print("joined", flush=True)
        node.wait_for_end()


if __name__ == "__main__":
    serve(*sys.argv[1:3])
