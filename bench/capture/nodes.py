"""Several hosts, one rig: eight nodes of four simulated cameras, in network namespaces of their own.

    sudo python -m bench.capture.nodes [--quick] [--json] [--write] [--seed 0]

The same capture is shot by one process, over the nodes, and over the nodes with trouble: a twentieth of all
camera operations is faulted, the clocks of five nodes jump by 30 ms to 2 s, and one node is killed as if its
mains were pulled, and started again while the others go on. --resume completes the capture. Cameras run in
real time; nodes have still and machine vision cameras in turn. Every file has to hold its hash, and to be
that of the one process, byte for byte, unless its shot was taken again. Where namespaces are not permitted
the nodes are processes only. --write puts the table into bench/results/nodes.md.
"""

import tempfile
import threading
import time
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from bench.capture.node_hosts import NODES, Hosts, cluster, model_of
from bench.support.record import arguments, deliver, machine, words
from capture.check.check import check
from capture.connected_rig import Unattended, connected_source
from capture.nodes.cluster import ray_links
from capture.nodes.node_settings import NodeSettings, place_of
from capture.record.capture_result import CaptureResult
from capture.record.shooting import shoot
from capture.request import CaptureRequest, RigRequest
from capture.rig_of_nodes import assignments_of, nodes_source
from capture.rigfile.rigfile import RigFile, read_rig_file
from drivers.clock import SystemClock
from drivers.sim.jumping_clock import JumpingClock
from imaging.files import store
from imaging.session.records import ShotRecord
from imaging.session.session import Session

HEAD = 'frames = {frames}\n[bracket]\nexposures = [-4, 0, 4]\ntime = "1/60"\nf_number = 8\n'
CAMERA = '[[camera]]\nname = "cam{n:02d}"\nserial = "SIM-RAW-{serial:03d}"\nrig = "rig"\nnode = "{node}"\n'
JUMPS = {1: 0.03, 2: -0.03, 3: 2.0, 4: -2.0, 5: 0.3}
"""Seconds by which the clocks of nodes jump, by their number."""
KILLED = -1
"""Number of the node that is killed, and started again."""
WITHIN = 3.0
"""Seconds before a shot was stored in which it was taken: a clock that jumps in them has two true offsets."""

Jumps = dict[str, tuple[tuple[float, float], ...]]


class Capture(NamedTuple):
    """A capture over nodes: seconds until all had begun, and then without joining; what was said."""

    joining: float
    seconds: float
    result: CaptureResult
    said: list[str]


def over_nodes(
    hosts: Hosts, rig: RigFile, out: Path, blink: tuple[str, int, Any] | None = None, resume: bool = False
) -> Capture:
    """A capture. blink: a node that is killed, the shots until then, and what starts it again."""
    said: list[str] = []
    again = None if blink is None else threading.Thread(target=blink[2])

    def watch(message: str, done: int, total: int) -> None:
        if blink is not None and again is not None and again.ident is None and done >= blink[1]:
            hosts.switch_off(blink[0])
            again.start()

    request, before = CaptureRequest(resume=resume), time.monotonic()
    with (
        ray_links(hosts.address, assignments_of(rig)) as links,
        nodes_source(rig, request, links, person=Unattended(), say=said.append) as source,
    ):
        began = time.monotonic()
        result = shoot(source, out, request, progress=watch)
        seconds = time.monotonic() - began
    if again is not None and again.ident is not None:
        again.join()
    return Capture(began - before, seconds, result, said)


def in_one_process(hosts: Hosts, rig: RigFile, out: Path, model: str) -> tuple[float, CaptureResult]:
    """The same, all cameras on the bus of this process."""
    place = place_of(
        NodeSettings(name="here", disk=hosts.folder / "here", sim="toy", profile=model, **hosts.settings)
    )
    assert place.rig is not None
    request = RigRequest(
        operator=place.rig, positions=place.rig.frames, backend=place.backend, clock=place.clock
    )
    with connected_source(rig, request) as source:
        began = time.monotonic()
        result = shoot(source, out, request)
        return time.monotonic() - began, result


def beyond(shot: ShotRecord, jumps: Jumps) -> bool:
    """Return True if the stated offset of a shot's clock is further than its error from every true one."""
    if shot.node is None or shot.clock_offset is None or shot.captured_at is None:
        return False
    clock = JumpingClock(SystemClock(), jumps=jumps.get(shot.node, ()))
    moments = [0.0, time.monotonic()]
    if shot.captured_at.tzinfo is not None:  # a node's own time; a still camera has only that of its dial
        stored = time.monotonic() - (datetime.now(UTC) - shot.captured_at).total_seconds()
        moments = [stored - WITHIN, stored]
    trues = {clock.ahead_at(moment) for moment in moments}
    return all(abs(shot.clock_offset - true) > (shot.clock_error or 0.0) for true in trues)


def _row(
    called: str, out: Path, seconds: float, result: CaptureResult, whole: dict[str, str], jumps: Jumps
) -> dict[str, Any]:
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
        "twice": len(store.read_lines(out / "shots.jsonl")) - len(shots),
        "retried": sum(shot.retries > 0 for shot in shots),
        "others": sum(whole.get(shot.file) != shot.sha256 and not shot.retries for shot in shots),
        "skew_ms": _spread(skews),
        "clock_error_ms": _spread(errors),
        "offset_beyond_error": sum(beyond(shot, jumps) for shot in shots),
    }


def _spread(seconds: list[float]) -> str:
    """Median and largest, ms; empty without any."""
    return f"{1e3 * median(seconds):.2f} ({1e3 * max(seconds):.2f})" if seconds else ""


def _files(session: Path) -> dict[str, str]:
    return {shot.file: shot.sha256 for shot in Session.open(session).shots()}


def _start(hosts: Hosts, names: tuple[str, ...], **more: dict[str, Any]) -> float:
    """Start all nodes; the seconds that it took. more: settings by node."""
    began = time.monotonic()
    for name in names:
        hosts.start(name, **more.get(name, {}))
    return time.monotonic() - began


def measure(names: tuple[str, ...], cameras: int, frames: int, seed: int) -> dict[str, Any]:
    count = cameras * len(names)
    settings = {"seed": seed, "changes": {"cameras": count, "samples": 1, "positions": frames}}
    rows, lost = [], names[KILLED]
    with tempfile.TemporaryDirectory() as place, cluster(Path(place), names, settings) as hosts:
        folder = hosts.folder
        text = HEAD.format(frames=frames)
        nodes = {f"cam{n:02d}": names[n // cameras] for n in range(count)}
        for n, node in enumerate(nodes.values()):
            text += CAMERA.format(n=n, serial=n + 1, node=node)
        (folder / "RIG.toml").write_text(text)
        rig = read_rig_file(folder / "RIG.toml")
        whole: dict[str, str] = {}
        for model in dict.fromkeys(map(model_of, names)):
            out = folder / model
            seconds, result = in_one_process(hosts, rig, out, model)
            mine = {shot.file for shot in Session.open(out).shots() if model_of(nodes[shot.camera]) == model}
            whole |= {file: digest for file, digest in _files(out).items() if file in mine}
            rows.append(_row(f"one process, {model}", out, seconds, result, _files(out), {}))
        starting = _start(hosts, names)
        calm = over_nodes(hosts, rig, folder / "calm")
        rows.append(_row("the nodes", folder / "calm", calm.seconds, calm.result, whole, {}))
        same = _files(folder / "calm") == whole
        hosts.stop()
        # Each clock jumps in the middle of the capture that begins once all nodes are up.
        ready = time.monotonic() + 1.5 * starting + 5.0
        jumps: Jumps = {
            names[number]: ((ready + calm.joining + (0.2 + 0.1 * number) * calm.seconds, by),)
            for number, by in JUMPS.items()
            if number < len(names) - 1
        }
        trouble: dict[str, dict[str, Any]] = {
            name: {"rough": True, "jumps": jumps.get(name, ())} for name in names
        }
        _start(hosts, names, **trouble)
        time.sleep(max(0.0, ready - time.monotonic()))
        blink = (lost, calm.result.planned // 8, lambda: hosts.start(lost, **trouble[lost]))
        rough = over_nodes(hosts, rig, folder / "rough", blink)
        rows.append(_row("with trouble", folder / "rough", rough.seconds, rough.result, whole, jumps))
        missing = Counter(nodes[one.split(",")[0]] for one in rough.result.missing)
        resumed = over_nodes(hosts, rig, folder / "rough", resume=True)
        rows.append(
            _row("completed by --resume", folder / "rough", resumed.seconds, resumed.result, whole, jumps)
        )
        apart = hosts.apart
        of_lost = [shot for shot in Session.open(folder / "rough").shots() if shot.node == lost]
    return {
        "machine": machine(),
        "nodes": len(names),
        "cameras": cameras,
        "frames": frames,
        "seed": seed,
        "namespaces": apart,
        "same_files": same,
        "said": rough.said + resumed.said,
        "unknown": [*rough.result.unknown, *resumed.result.unknown],
        "jumps": {name: by for name, ((_, by),) in jumps.items()},
        "lost": lost,
        "of_lost": len(of_lost),
        "missing": dict(missing),
        "rows": rows,
    }


def report(result: dict[str, Any]) -> str:
    rows = []
    for row in result["rows"]:
        rows.append(
            f"| {row['called']} | {row['seconds']:.1f} | {row['earlier'] + row['taken']} "
            f"of {row['planned']} | {row['sound']} | {len(row['missing'])} | {row['twice']} | "
            f"{row['retried']} | {row['others']} | "
            f"{row['skew_ms']} | {row['clock_error_ms']} | {row['offset_beyond_error']} |"
        )
    kind = "network namespaces" if result["namespaces"] else "processes"
    same = "are" if result["same_files"] else "are NOT"
    lost, missing = result["lost"], result["missing"]
    others = sum(count for name, count in missing.items() if name != lost)
    jumps = ", ".join(f"{name} {by:+g} s" for name, by in result["jumps"].items())
    noticed = sum(line.startswith("The clock of node") for line in result["said"])
    return "\n".join(
        [
            "# Several hosts, one rig",
            "",
            f"`python -m bench.capture.nodes --write`: {result['nodes']} nodes ({kind} of one machine) of "
            f"{result['cameras']} simulated cameras, PTP and USB3 Vision by turns, 3 exposures x "
            f"{result['frames']} frames, seed {result['seed']}, in real time. {words(result['machine'])}.",
            "",
            "| | s | shots | sound | missing | recorded twice | retried | other bytes, not retried | skew, "
            "ms: median (largest) | clock error, ms: median (largest) | true offset beyond its error |",
            "|---|---|---|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            f"The files of the nodes without trouble {same} those of one process, byte for byte. Trouble: "
            f"5 % of camera operations are faulted; node {lost} is killed after an eighth of the shots and "
            f"started again at once; clocks jump ({jumps}).",
            "",
            f"Missing before --resume: {missing.get(lost, 0)} of {lost}'s {result['of_lost']} shots, "
            f"{others} of others. Jumps noticed: {noticed} of {len(result['jumps'])}; shots that one "
            f"fell into: {sum('jumped' in line for line in result['unknown'])}, of unknown skew. Said:",
            "",
            *(f"- {line}" for line in result["said"]),
            "",
            "All of it shares two cores and one clock: seconds and skews are those of a machine that also "
            "renders what all cameras see.",
            "",
        ]
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    names, cameras, frames = (NODES[:3], 1, 6) if options.quick else (NODES, 4, 8)
    result = measure(names, cameras, frames, options.seed)
    deliver(options, "nodes", result, report(result))


if __name__ == "__main__":
    main()
