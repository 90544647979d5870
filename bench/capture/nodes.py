"""Several hosts, one rig: four nodes of eight simulated cameras, in network namespaces of their own.

    sudo python -m bench.capture.nodes [--quick] [--json] [--write] [--seed 0]

The same capture is shot by one process, over four nodes, and over four nodes a twentieth of whose camera
operations are faulted and of which one is killed in the middle, as if its mains were pulled; that one is then
started again and the capture completed by --resume. Cameras run in real time. Every file has to hold its
hash; without faults the files have to be those of the one process, byte for byte. Where namespaces are not
permitted the nodes are processes only. --write puts the table into bench/results/nodes.md.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from bench.support.record import arguments, deliver, machine, words
from capture.check.check import check
from capture.connected_rig import Unattended, connected_source
from capture.nodes.cluster import ray_links
from capture.nodes.joining import joined_as
from capture.nodes.node_settings import VARIABLE, NodeSettings, place_of
from capture.record.capture_run import CaptureResult
from capture.record.shooting import shoot
from capture.request import CaptureRequest, RigRequest
from capture.rig_of_nodes import assignments_of, nodes_source
from capture.rigfile.rigfile import RigFile, read_rig_file
from imaging.session.session import Session

NODES = ("north", "east", "south", "west")
PORT, SUBNET, BRIDGE = 6391, "10.77.31", "rigbench"
HEAD = 'frames = {frames}\n[bracket]\nexposures = [-4, 0, 4]\ntime = "1/60"\nf_number = 8\n'
CAMERA = '[[camera]]\nname = "cam{n:02d}"\nserial = "SIM-RAW-{serial:03d}"\nrig = "rig"\nnode = "{node}"\n'
SERVE = "--serve"


@dataclass
class Hosts:
    """The nodes, and the address of the cluster. apart: each in a namespace."""

    folder: Path
    settings: dict[str, Any]
    apart: bool
    address: str
    up: dict[str, "subprocess.Popen[str]"] = field(default_factory=dict)

    def start(self, name: str, **more: Any) -> None:
        """Start a node and wait until it has joined."""
        settings = NodeSettings(name=name, disk=self.folder / name, sim="toy", **self.settings, **more)
        command = [
            sys.executable,
            "-m",
            "bench.capture.nodes",
            SERVE,
            settings.model_dump_json(),
            self.address,
        ]
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

    def stop(self, name: str) -> None:
        """Remove a node."""
        process = self.up.pop(name)
        process.send_signal(signal.SIGINT)
        process.wait()


def _space(name: str) -> str:
    return f"{BRIDGE}-{name}"


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


@contextmanager
def namespaces() -> Iterator[bool]:
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
            for number, name in enumerate(NODES):
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
def cluster(folder: Path, settings: dict[str, Any]) -> Iterator[Hosts]:
    """A head on this host, no node yet."""
    with namespaces() as apart:
        host = f"{SUBNET}.254" if apart else "127.0.0.1"
        command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--head", "--block"]
        command += ["--port", str(PORT), "--node-ip-address", host, "--num-cpus", "1"]
        command += ["--include-dashboard", "False", "--disable-usage-stats"]
        head = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert head.stdout is not None
        while "Ray runtime started" not in (line := head.stdout.readline()):
            if not line:
                raise SystemExit("ray start --head failed: ray stop ends one that is left over")
        hosts = Hosts(folder, settings, apart, f"{host}:{PORT}")
        try:
            yield hosts
        finally:
            for name in list(hosts.up):
                hosts.stop(name)
            head.terminate()
            head.wait()


def over_nodes(
    hosts: Hosts, rig: RigFile, out: Path, kill_at: int | None = None, resume: bool = False
) -> Any:
    """A capture: its seconds without joining, what it came to, and what was said. kill_at: shots done."""
    said: list[str] = []

    def watch(message: str, done: int, total: int) -> None:
        if kill_at is not None and done >= kill_at and NODES[-1] in hosts.up:
            hosts.switch_off(NODES[-1])

    request = CaptureRequest(resume=resume)
    with (
        ray_links(hosts.address, assignments_of(rig)) as links,
        nodes_source(rig, request, links, person=Unattended(), say=said.append) as source,
    ):
        began = time.monotonic()
        result = shoot(source, out, request, progress=watch)
        return time.monotonic() - began, result, said


def in_one_process(hosts: Hosts, rig: RigFile, out: Path) -> tuple[float, CaptureResult]:
    """The same, all cameras on the bus of this process."""
    place = place_of(NodeSettings(name="here", disk=hosts.folder / "here", sim="toy", **hosts.settings))
    assert place.rig is not None
    request = RigRequest(
        operator=place.rig, positions=place.rig.frames, backend=place.backend, clock=place.clock
    )
    with connected_source(rig, request) as source:
        began = time.monotonic()
        result = shoot(source, out, request)
        return time.monotonic() - began, result


def _row(called: str, out: Path, seconds: float, result: CaptureResult) -> dict[str, Any]:
    shots = Session.open(out).shots()
    errors = [shot.clock_error for shot in shots if shot.clock_error is not None]
    # A shot that was taken again is late by that, whatever its node.
    skews = [shot.skew for shot in shots if shot.skew is not None and not shot.retries]
    return {
        "called": called,
        "seconds": seconds,
        "planned": result.planned,
        "taken": result.taken,
        "earlier": result.earlier,
        "sound": check(out).sound,
        "missing": list(result.missing),
        "retried": sum(shot.retries > 0 for shot in shots),
        "skew_median_ms": 1e3 * median(skews),
        "skew_largest_ms": 1e3 * max(skews),
        "clock_error_median_ms": 1e3 * median(errors) if errors else None,
        "clock_error_largest_ms": 1e3 * max(errors) if errors else None,
        "offset_beyond_error": sum(
            abs(shot.clock_offset) > (shot.clock_error or 0.0)
            for shot in shots
            if shot.clock_offset is not None
        ),
    }


def _files(session: Path) -> dict[str, str]:
    return {shot.file: shot.sha256 for shot in Session.open(session).shots()}


def measure(cameras: int, frames: int, seed: int) -> dict[str, Any]:
    settings = {"seed": seed, "changes": {"cameras": cameras * len(NODES), "samples": 1, "positions": frames}}
    rows = []
    with tempfile.TemporaryDirectory() as place, cluster(Path(place), settings) as hosts:
        folder = hosts.folder
        text = HEAD.format(frames=frames)
        for n in range(cameras * len(NODES)):
            text += CAMERA.format(n=n, serial=n + 1, node=NODES[n // cameras])
        (folder / "RIG.toml").write_text(text)
        rig = read_rig_file(folder / "RIG.toml")
        rows.append(_row("one process", folder / "one", *in_one_process(hosts, rig, folder / "one")))
        for name in NODES:
            hosts.start(name)
        seconds, result, _ = over_nodes(hosts, rig, folder / "calm")
        rows.append(_row("four nodes", folder / "calm", seconds, result))
        same = _files(folder / "calm") == _files(folder / "one")
        for name in NODES:
            hosts.stop(name)
        for name in NODES:
            hosts.start(name, rough=True)
        half = result.planned // 2
        seconds, result, said = over_nodes(hosts, rig, folder / "rough", kill_at=half)
        rows.append(_row("with faults, a node killed", folder / "rough", seconds, result))
        of_others = [one for one in result.missing if int(one[3:5]) < cameras * (len(NODES) - 1)]
        hosts.start(NODES[-1], rough=True)
        seconds, result, more = over_nodes(hosts, rig, folder / "rough", resume=True)
        rows.append(_row("completed by --resume", folder / "rough", seconds, result))
        apart = hosts.apart
    return {
        "machine": machine(),
        "cameras": cameras,
        "frames": frames,
        "seed": seed,
        "namespaces": apart,
        "same_files": same,
        "said": said + more,
        "missing_of_other_nodes": len(of_others),
        "rows": rows,
    }


def report(result: dict[str, Any]) -> str:
    rows = []
    for row in result["rows"]:
        errors = row["clock_error_median_ms"], row["clock_error_largest_ms"]
        clock = "" if errors[0] is None else f"{errors[0]:.2f} ({errors[1]:.2f})"
        rows.append(
            f"| {row['called']} | {row['seconds']:.1f} | {row['earlier'] + row['taken']} "
            f"of {row['planned']} | {row['sound']} | {len(row['missing'])} | {row['retried']} | "
            f"{row['skew_median_ms']:.2f} ({row['skew_largest_ms']:.2f}) | {clock} | "
            f"{row['offset_beyond_error']} |"
        )
    count = len(NODES)
    kind = "network namespaces" if result["namespaces"] else "processes"
    same = "are" if result["same_files"] else "are NOT"
    return "\n".join(
        [
            "# Several hosts, one rig",
            "",
            f"`python -m bench.capture.nodes --write`: {count} nodes ({kind} of one machine) of "
            f"{result['cameras']} simulated cameras, 3 exposures x {result['frames']} frames, seed "
            f"{result['seed']}, in real time. {words(result['machine'])}.",
            "",
            "| | s | shots | sound | missing | retried | skew, ms: median (largest) | clock error, ms: "
            "median (largest) | true offset, 0, beyond its error |",
            "|---|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            f"The files of four nodes {same} those of one process, byte for byte. Of the nodes that were not "
            f"killed, {result['missing_of_other_nodes']} shots are missing. Said of the one that was: "
            f"{' '.join(result['said'])}",
            "",
            "All of it shares two cores and one clock: seconds and skews are those of a machine that also "
            "renders what all cameras see.",
            "",
        ]
    )


def serve(settings: str, address: str) -> None:
    """A node, until it is interrupted."""
    with joined_as(NodeSettings.model_validate_json(settings), address) as node, suppress(KeyboardInterrupt):
        print("joined", flush=True)
        node.wait_for_end()


def main() -> None:
    if sys.argv[1:2] == [SERVE]:
        serve(*sys.argv[2:4])
        return
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    cameras, frames = (2, 2) if options.quick else (8, 4)
    result = measure(cameras, frames, options.seed)
    deliver(options, "nodes", result, report(result))


if __name__ == "__main__":
    main()
