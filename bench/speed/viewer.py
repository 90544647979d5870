"""Latency of `rig view`: its first picture, pictures while the camera moves, and the one after it.

    python -m bench.speed.viewer [--quick] [--json] [--write] [--gaussians 100000] [--seconds 10]
                                 [--repeats 3] [--work FOLDER]

The demo's scene is trained as a draft, and its Gaussians are split until there are as many as asked for.
`rig view` runs as a command; a browser is played by a websocket that says where its camera stands fifty times
a second, as a browser does that is dragged, in a window of 640x360, and takes the pictures that come, which
it does not draw. Times are wall clock, from the command on where that is said.
"""

import argparse
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import torch
import viser
import zstandard
from websockets import Subprotocol
from websockets.sync.client import ClientConnection, connect

from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import session
from recon.result.model import CHECKPOINT
from recon.result.scene import open_scene
from recon.scene.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rig.view.serving.start_view import pose_of

WIDTH, HEIGHT = 640, 360
PERIOD = 0.02
"""Seconds between two cameras that a browser sends."""
LIMIT = 60.0


def scene_of(work: Path, sim: str, count: int) -> Path:
    """Reconstruction of the demo with that many Gaussians, made if it does not exist."""
    place = session(work, sim, 0, "truth")
    trained = place / "reconstructions" / "viewer"
    if not (trained / "model.json").exists():
        command = ["reconstruct", str(place), "--name", "viewer", "--quality", "draft"]
        subprocess.run([sys.executable, "-m", "rig", *command], check=True, stdout=subprocess.DEVNULL)
    split = place / "reconstructions" / f"viewer-{count}"
    if not (split / "model.json").exists():
        shutil.copytree(trained, split, dirs_exist_ok=True)
        checkpoint = read_checkpoint(split / CHECKPOINT)
        others = {name: part for name, part in checkpoint.tensors.items() if not name.startswith("adam.")}
        parts = {f"gaussians.{name}": part for name, part in _split(checkpoint, count).items()}
        write_checkpoint(split / CHECKPOINT, Checkpoint(others | parts, checkpoint.facts))
    return split


def _split(checkpoint: Checkpoint, count: int) -> dict[str, torch.Tensor]:
    """Gaussians in place of each one, drawn from it and smaller, as density control splits them."""
    old = checkpoint.part("gaussians")
    index = torch.arange(count) % len(old["means"])
    new = {name: part[index].clone() for name, part in old.items()}
    pieces = torch.bincount(index, minlength=len(old["means"]))[index].float()
    w, x, y, z = torch.nn.functional.normalize(new["quats"], dim=1).unbind(1)
    axes = torch.stack(
        [
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        ],
        1,
    ).reshape(-1, 3, 3)  # fmt: skip
    away = torch.randn(count, 3, generator=torch.Generator().manual_seed(0)) * new["log_scales"].exp()
    new["means"] += torch.where(pieces > 1, 0.8, 0.0)[:, None] * (axes @ away[..., None])[..., 0]
    new["log_scales"] -= torch.where(pieces > 1, torch.log(0.8 * pieces), 0.0)[:, None]
    return new


class Browser:
    """A window of WIDTH x HEIGHT whose camera turns about what the scene's first view looks at."""

    socket: ClientConnection

    def __init__(self, folder: Path) -> None:
        scene = open_scene(folder)
        camera = scene.record.world.camera(scene.views[0].splat_camera)
        self._turn, self._position = pose_of(camera.cam_from_world)
        self._up = scene.up
        self._ahead = camera.cam_from_world[2, :3]

    def stand(self, angle: float) -> None:
        """Move the camera to an angle, radians, from its start, about the subject at distance 1."""
        half = 0.5 * angle
        turn = np.array([math.cos(half), *(math.sin(half) * self._up)])
        target = self._position + self._ahead
        position = target + _rotated(turn, self._position - target)
        message = {
            "type": "ViewerCameraMessage",
            "wxyz": _product(turn, self._turn).tolist(),
            "position": position.tolist(),
            "fov": 0.75,
            "near": 0.01,
            "far": 1000.0,
            "image_height": HEIGHT,
            "image_width": WIDTH,
            "look_at": target.tolist(),
            "up_direction": self._up.tolist(),
        }
        self.socket.send(msgspec.msgpack.encode(message))

    def pictures(self, seconds: float) -> Iterator[tuple[float, int]]:
        """Yield the arrival time of each picture within that many seconds, and its width, px."""
        end = time.perf_counter() + seconds
        while (remaining := end - time.perf_counter()) > 0:
            try:
                data = self.socket.recv(timeout=remaining)
            except TimeoutError:
                return
            now = time.perf_counter()
            assert isinstance(data, bytes)
            length = int.from_bytes(data[8:16], "little")
            packed = zstandard.ZstdDecompressor().decompress(data[16 : 16 + length])
            for message in msgspec.msgpack.decode(packed)["messages"]:
                if message["type"] == "BackgroundImageMessage" and message["rgb_data"] is not None:
                    codes = np.frombuffer(message["rgb_data"], np.uint8)
                    picture = cv2.imdecode(codes, cv2.IMREAD_COLOR)
                    assert picture is not None
                    yield now, picture.shape[1]


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of quaternions wxyz."""
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.concatenate([[w], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def _rotated(turn: np.ndarray, vector: np.ndarray) -> np.ndarray:
    twice = 2 * np.cross(turn[1:], vector)
    return np.asarray(vector + turn[0] * twice + np.cross(turn[1:], twice))


@contextmanager
def command(folder: Path, port: int) -> Iterator[tuple[int, float]]:
    """`rig view` of a scene: the number of its process, and when it was started."""
    began = time.perf_counter()
    words = [sys.executable, "-m", "rig", "view", str(folder), "--port", str(port)]
    nowhere = subprocess.DEVNULL
    with subprocess.Popen(words, stdout=nowhere, stderr=nowhere) as process:
        try:
            yield process.pid, began
        finally:
            process.terminate()


def used(process: int) -> float:
    """Processor time of a process so far, s (field 14 and 15 of proc_pid_stat(5))."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def connected(port: int) -> ClientConnection:
    """A websocket to the page, as soon as it is served."""
    end = time.perf_counter() + LIMIT
    protocols = [Subprotocol(f"viser-v{viser.__version__}")]
    while True:
        try:
            return connect(f"ws://127.0.0.1:{port}", subprotocols=protocols, compression=None, max_size=None)
        except OSError:
            if time.perf_counter() > end:
                raise
            time.sleep(0.01)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    folder = scene_of(options.work, options.sim, options.gaussians)
    rows, browser = [], Browser(folder)
    for turn in range(options.repeats):
        with command(folder, options.port + turn) as (process, began):
            browser.socket = connected(options.port + turn)
            row = {"served": time.perf_counter() - began, "served_cpu": used(process)}
            browser.stand(0.0)
            coming = browser.pictures(LIMIT)
            row |= {"first": next(coming)[0] - began, "first_cpu": used(process)}
            row |= {"drawn": next(coming)[0] - began, "drawn_cpu": used(process)}
            for _ in browser.pictures(2.0):
                pass
            row |= _moved(browser, process, options.seconds)
            rows.append(row)
            browser.socket.close()
    median = {name: float(np.median([row[name] for row in rows])) for name in rows[0]}
    return {"machine": machine(), "gaussians": options.gaussians, "rows": rows} | median


def _moved(browser: Browser, process: int, seconds: float) -> dict[str, float]:
    """A camera that is moved for a while, then not."""
    came: list[tuple[float, int]] = []
    before = used(process)
    start = time.perf_counter()
    while time.perf_counter() < start + seconds:
        browser.stand(0.2 * math.sin(1.5 * (time.perf_counter() - start)))
        came += browser.pictures(PERIOD)
    stopped, spent = time.perf_counter(), used(process) - before
    after = list(browser.pictures(3.0))
    still = next((when for when, width in after if width == WIDTH), math.nan)
    times = [when for when, _ in came if when > start + 1]
    gaps = np.diff(times)
    return {
        "fps": len(gaps) / (times[-1] - times[0]),
        "slowest_tenth_ms": 1e3 * float(np.quantile(gaps, 0.9)),
        "cpu_ms": 1e3 * spent / len(came),
        "width": float(np.median([width for when, width in came if when > start + 1])),
        "still": still - stopped,
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# The viewer's speed",
        "",
        f"`python -m bench.speed.viewer --write`: {result['gaussians']} Gaussians in a window of "
        f"{WIDTH}x{HEIGHT}; medians of {len(result['rows'])} runs. {words(result['machine'])}. On a machine "
        "with other work the wall clock shows that too; the processor time of the command, over all its "
        "threads, does not.",
        "",
        "| from the command on | s | processor time, s |",
        "|---|---|---|",
        f"| the page is served | {result['served']:.1f} | {result['served_cpu']:.1f} |",
        f"| a picture that the evaluation drew | {result['first']:.1f} | {result['first_cpu']:.1f} |",
        f"| the first that is drawn anew | {result['drawn']:.1f} | {result['drawn_cpu']:.1f} |",
        "",
        "| moving | |",
        "|---|---|",
        f"| pictures a second | {result['fps']:.0f} |",
        f"| nine in ten follow the last one within, ms | {result['slowest_tenth_ms']:.0f} |",
        f"| processor time a picture, ms | {result['cpu_ms']:.0f} |",
        f"| their width, px | {result['width']:.0f} |",
        f"| full size after the camera stopped, s | {result['still']:.2f} |",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--gaussians", type=int, default=100_000)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--port", type=int, default=18080)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.sim = "demo"
    if options.quick:
        options.sim = "toy"
        options.gaussians, options.seconds, options.repeats = 2000, 2.0, 1
    result = measure(options)
    deliver(options, "viewer", result, report(result))


if __name__ == "__main__":
    main()
