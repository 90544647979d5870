"""Speed and memory of a capture to the disk: cameras that deliver at once.

    python -m bench.capture.recording [--quick] [--json] [--write] [--folder FOLDER]

Eight cameras in memory replay a mosaic of 24 megapixels, stamped with camera and shot, through the recorder
on the machine's clock into a session in FOLDER, five shots at a time. Before and after each of these parts
`dd` writes as many frames to one file that it syncs once, so that whatever disturbs the disk hits both; the
recorder's frames are hashed, and each is a file that is synced. All files are deleted afterwards.
--write puts the table into bench/results/recording.md.
"""

import os
import shutil
import subprocess
import tempfile
import time
import weakref
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.record import arguments, deliver, machine, words
from capture.record.new_session import begin
from capture.record.recorder import record
from drivers.camera import CameraIdentity, Capabilities
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.records import CameraRecord, PlanRecord, SessionRecord

CAMERAS, SHOTS, QUICK_SHOTS, PART = 8, 25, 5, 5
WIDTH, HEIGHT = 6000, 4000


class Buffers:
    """Copies of a mosaic, each reused once it is released, as a driver does it."""

    def __init__(self, mosaic: np.ndarray) -> None:
        self._mosaic = mosaic
        self._free: list[bytearray] = []

    def take(self) -> np.ndarray:
        """One of them, uint16 [H, W]."""
        try:
            buffer = self._free.pop()
        except IndexError:
            buffer = bytearray(self._mosaic.data.cast("B"))
        pixels = np.frombuffer(buffer, np.uint16)
        weakref.finalize(pixels, self._free.append, buffer)
        return pixels.reshape(self._mosaic.shape)


class Replaying:
    """A camera whose next picture is always there."""

    def __init__(self, number: int, buffers: Buffers) -> None:
        self.number, self.buffers, self.shots = number, buffers, 0
        self.exposure = Exposure(time=1 / 60)

    @property
    def where(self) -> str:
        """Empty: it is on no bus."""
        return ""

    def verified(self) -> str:
        """Verify nothing: there is no camera."""
        return "memory"

    def identify(self) -> CameraIdentity:
        """Return the identity."""
        return CameraIdentity(f"replay-{self.number}", "hdr-rig", "replay", "raw")

    def capabilities(self) -> Capabilities:
        """One exposure."""
        return Capabilities(WIDTH, HEIGHT, 14, (1 / 60,), (), ())

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Accept any exposure."""
        self.exposure = exposure
        return exposure

    def arm(self) -> None:
        """Do nothing: it is always armed."""

    def trigger(self) -> float:
        """Trigger at once."""
        self.shots += 1
        return time.monotonic()

    def collect(self) -> RawMosaic:
        """The mosaic, stamped."""
        pixels = self.buffers.take()
        pixels[0, :2] = self.number, self.shots
        metadata = FrameMetadata(serial=f"replay-{self.number}", exposure=self.exposure)
        return RawMosaic(pixels, Cfa.RGGB, ((512.0,),), 16383, metadata=metadata)

    def close(self) -> None:
        """Do nothing: there is nothing to close."""


def replayed() -> np.ndarray:
    """Return what all cameras see, uint16 [H, W]: noise, which no disk can pack."""
    return np.random.default_rng(0).integers(500, 16384, (HEIGHT, WIDTH), dtype=np.uint16)


def resident() -> int:
    """Bytes of memory that this process holds now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def peak_since_reset() -> int:
    """The most that it held since `reset_peak`; the kernel counts, so that nothing falls between samples."""
    status = Path("/proc/self/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("VmHWM")).split()[1]) * 1024


def reset_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


class Replay:
    """A session that the cameras fill part by part. peaks: of memory, up to the end of each shot."""

    def __init__(self, folder: Path) -> None:
        buffers = Buffers(replayed())
        self.cameras = {f"cam{number}": Replaying(number, buffers) for number in range(CAMERAS)}
        records = tuple(
            CameraRecord(name=name, serial=camera.identify().serial, kind="raw")
            for name, camera in self.cameras.items()
        )
        identity = SessionRecord(name="recording", created=datetime.now(UTC), origin="bench", cameras=records)
        self.session = begin(folder, identity)
        self.peaks: list[int] = []
        self.before = resident()

    def take(self, frames: range) -> float:
        """Seconds that the recorder needs for these."""
        plan = PlanRecord(
            plan=f"scene{frames.start}",
            kind="scene",
            created=datetime.now(UTC),
            bracket=(Exposure(time=1 / 60),),
            frames=tuple(frames),
            cameras=tuple(self.cameras),
            reason="bench/capture/recording.py",
        )
        self.session.append_plan(plan)
        reset_peak()
        began = time.perf_counter()
        record(self.session, plan, self.cameras, progress=self._sample).require_complete()
        return time.perf_counter() - began

    def _sample(self, message: str, done: int, total: int) -> None:
        if done and done % CAMERAS == 0:
            self.peaks.append(peak_since_reset())
            reset_peak()

    def size(self) -> int:
        """Bytes of all files, which are all different."""
        shots = self.session.shots()
        assert len({shot.sha256 for shot in shots}) == len(shots)
        return sum(self.session.file(shot).stat().st_size for shot in shots)


def control(folder: Path, frames: int) -> float:
    """Seconds in which `dd` writes as many frames, of the mosaic in `folder`, to one file that it syncs."""
    file = folder / "control"
    append = "bs=1M oflag=append conv=notrunc"
    frame = f'dd if="$1" of="$2" {append}'
    script = f'for i in $(seq {frames}); do {frame}; done; dd if=/dev/null of="$2" {append},fsync'
    began = time.perf_counter()
    subprocess.run(["sh", "-c", script, "sh", folder / "frame", file], check=True, capture_output=True)
    seconds = time.perf_counter() - began
    file.unlink()
    return seconds


def measure(place: Path, shots: int) -> dict[str, Any]:
    size = CAMERAS * (shots + PART) * WIDTH * HEIGHT * 2
    free = shutil.disk_usage(place).free
    if free < 1.2 * size:
        raise SystemExit(f"{place} has {free / 1e9:.1f} GB free, not {1.2 * size / 1e9:.1f}: name another.")
    with tempfile.TemporaryDirectory(dir=place) as name:
        folder = Path(name)
        replayed().tofile(folder / "frame")
        replay, seconds = Replay(folder / "session"), []
        controls = [control(folder, CAMERAS * PART)]
        for first in range(0, shots, PART):
            seconds.append(replay.take(range(first, first + PART)))
            controls.append(control(folder, CAMERAS * PART))
        written = replay.size() / 1e6
    part = written / len(seconds)
    beside = [(before + after) / 2 for before, after in pairwise(controls)]
    rate, control_rate = written / sum(seconds), written / sum(beside)
    later = replay.peaks[3:]
    return {
        "machine": machine(),
        "cameras": CAMERAS,
        "shots": shots,
        "megapixels": WIDTH * HEIGHT / 1e6,
        "megabytes": written,
        "seconds": sum(seconds),
        "megabytes_per_second": rate,
        "dd_megabytes_per_second": control_rate,
        "parts_megabytes_per_second": [round(part / one) for one in seconds],
        "dd_parts_megabytes_per_second": [round(part / one) for one in controls],
        "ratio": rate / control_rate,
        "before_megabytes": replay.before / 1e6,
        "peak_megabytes": max(replay.peaks) / 1e6,
        "peaks_megabytes": [round(peak / 1e6) for peak in replay.peaks],
        "growth_after_third_megabytes": (max(later) - max(replay.peaks[:3])) / 1e6,
    }


def report(result: dict[str, Any]) -> str:
    parts, controls = (
        ", ".join(str(rate) for rate in result[name])
        for name in ("parts_megabytes_per_second", "dd_parts_megabytes_per_second")
    )
    rows = [
        ("written", f"{result['megabytes']:.0f} MB in {result['seconds']:.1f} s"),
        ("rate", f"{result['megabytes_per_second']:.0f} MB/s ({parts})"),
        ("`dd conv=fsync` beside it", f"{result['dd_megabytes_per_second']:.0f} MB/s ({controls})"),
        ("share of it", f"{result['ratio']:.2f}"),
        ("memory before the first shot", f"{result['before_megabytes']:.0f} MB"),
        ("peak", f"{result['peak_megabytes']:.0f} MB"),
        ("growth of the peak after the third shot", f"{result['growth_after_third_megabytes']:.0f} MB"),
    ]
    return "\n".join(
        [
            "# A capture on its way to the disk",
            "",
            f"`python -m bench.capture.recording --write`: {result['cameras']} cameras x "
            f"{result['shots']} shots x "
            f"{result['megapixels']:.0f} megapixels, uncompressed DNG. {words(result['machine'])}. Before "
            "and after every five shots `dd` writes as much to one file and syncs once; the recorder hashes, "
            "and syncs each file.",
            "",
            "| | |",
            "|---|---|",
            *(f"| {name} | {value} |" for name, value in rows),
            "",
        ]
    )


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    options = parser.parse_args()
    result = measure(options.folder, QUICK_SHOTS if options.quick else SHOTS)
    deliver(options, "recording", result, report(result))


if __name__ == "__main__":
    main()
