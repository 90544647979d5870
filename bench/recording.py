"""How fast a capture reaches the disk, and in how much memory: cameras that deliver at once.

    python bench/recording.py [--quick] [--json] [--write] [--folder FOLDER]

Eight cameras in memory replay a mosaic of 24 megapixels, stamped with camera and shot, through the recorder
on the machine's clock into a session in FOLDER. In the same run `dd` writes as many frames to one file that
it syncs once; the recorder's are hashed twice, and each is a file that is synced. All files are deleted
afterwards. --write puts the table into bench/results/recording.md.
"""

import os
import shutil
import statistics
import subprocess
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from record import arguments, deliver, machine, words

from capture.beginning import begin
from capture.recorder import record
from drivers.camera import CameraIdentity, Capabilities
from imaging.cfa import Cfa
from imaging.exposure import Exposure
from imaging.mosaic import FrameMetadata, RawMosaic
from imaging.records import CameraRecord, PlanRecord, SessionRecord

CAMERAS, SHOTS, QUICK_SHOTS = 8, 25, 3
WIDTH, HEIGHT = 6000, 4000
MEBIBYTE = 1 << 20


class Replaying:
    """A camera whose next picture is always there."""

    def __init__(self, number: int, mosaic: np.ndarray) -> None:
        self.number, self.mosaic, self.shots = number, mosaic, 0
        self.exposure = Exposure(time=1 / 60)

    def identify(self) -> CameraIdentity:
        """Who it is."""
        return CameraIdentity(f"replay-{self.number}", "hdr-rig", "replay", "raw")

    def capabilities(self) -> Capabilities:
        """One exposure."""
        return Capabilities(WIDTH, HEIGHT, 14, (1 / 60,), (), ())

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Whatever is asked for."""
        self.exposure = exposure
        return exposure

    def arm(self) -> None:
        """It always is."""

    def trigger(self) -> float:
        """At once."""
        self.shots += 1
        return time.monotonic()

    def collect(self) -> RawMosaic:
        """The mosaic, stamped."""
        pixels = self.mosaic.copy()
        pixels[0, :2] = self.number, self.shots
        metadata = FrameMetadata(serial=f"replay-{self.number}", exposure=self.exposure)
        return RawMosaic(pixels, Cfa.RGGB, (512.0,) * 4, 16383, metadata=metadata)

    def close(self) -> None:
        """There is nothing to let go of."""


def replayed() -> np.ndarray:
    """What all cameras see, uint16 [H, W]: noise, which no disk can pack."""
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


def capture(folder: Path, shots: int) -> dict[str, Any]:
    """Seconds, bytes, and the peak of memory up to the end of each shot of the rig."""
    mosaic = replayed()
    cameras = {f"cam{number}": Replaying(number, mosaic) for number in range(CAMERAS)}
    now = datetime.now(UTC)
    records = tuple(CameraRecord(name=n, serial=c.identify().serial, kind="raw") for n, c in cameras.items())
    identity = SessionRecord(name="recording", created=now, origin="bench", cameras=records)
    session = begin(folder, identity)
    plan = PlanRecord(
        plan="scene",
        kind="scene",
        created=now,
        bracket=(Exposure(time=1 / 60),),
        frames=tuple(range(shots)),
        cameras=tuple(cameras),
        reason="bench/recording.py",
    )
    session.append_plan(plan)
    peaks: list[int] = []

    def sample(message: str, done: int, total: int) -> None:
        if done and done % CAMERAS == 0:
            peaks.append(peak_since_reset())
            reset_peak()

    reset_peak()
    before, began = resident(), time.perf_counter()
    result = record(session, plan, cameras, progress=sample)
    seconds = time.perf_counter() - began
    result.require_complete()
    size = sum(session.file(shot).stat().st_size for shot in session.shots())
    different = len({shot.sha256 for shot in session.shots()})
    assert different == CAMERAS * shots
    return {"seconds": seconds, "bytes": size, "before": before, "peaks": peaks}


def control(folder: Path, frames: int) -> float:
    """Seconds in which `dd` writes as many frames, of the same mosaic, to one file that it syncs."""
    source, file = folder / "frame", folder / "control"
    replayed().tofile(source)
    script = f'for i in $(seq {frames}); do cat "$1"; done | dd of="$2" bs=1M iflag=fullblock conv=fsync'
    began = time.perf_counter()
    subprocess.run(["sh", "-c", script, "sh", source, file], check=True, capture_output=True)
    seconds = time.perf_counter() - began
    file.unlink()
    return seconds


def measure(place: Path, shots: int) -> dict[str, Any]:
    size = CAMERAS * shots * WIDTH * HEIGHT * 2
    free = shutil.disk_usage(place).free
    if free < 1.2 * size:
        raise SystemExit(f"{place} has {free / 1e9:.1f} GB free, not {1.2 * size / 1e9:.1f}: name another.")
    with tempfile.TemporaryDirectory(dir=place) as folder:
        # The control before and after: a disk that others use does not stay as fast as it was.
        before = control(Path(folder), CAMERAS * shots)
        taken = capture(Path(folder) / "session", shots)
        shutil.rmtree(Path(folder) / "session")
        after = control(Path(folder), CAMERAS * shots)
    megabytes = taken["bytes"] / 1e6
    rate, controls = megabytes / taken["seconds"], [megabytes / before, megabytes / after]
    later = taken["peaks"][3:]
    return {
        "machine": machine(),
        "cameras": CAMERAS,
        "shots": shots,
        "megapixels": WIDTH * HEIGHT / 1e6,
        "megabytes": megabytes,
        "seconds": taken["seconds"],
        "megabytes_per_second": rate,
        "dd_megabytes_per_second": controls,
        "ratio": rate / statistics.mean(controls),
        "before_megabytes": taken["before"] / 1e6,
        "peak_megabytes": max(taken["peaks"]) / 1e6,
        "peaks_megabytes": [round(peak / 1e6) for peak in taken["peaks"]],
        "growth_after_third_megabytes": (max(later) - max(taken["peaks"][:3])) / 1e6 if later else None,
    }


def report(result: dict[str, Any]) -> str:
    growth = result["growth_after_third_megabytes"]
    controls = " and ".join(f"{rate:.0f}" for rate in result["dd_megabytes_per_second"])
    rows = [
        ("written", f"{result['megabytes']:.0f} MB in {result['seconds']:.1f} s"),
        ("rate", f"{result['megabytes_per_second']:.0f} MB/s"),
        ("`dd conv=fsync` of as many bytes, before and after", f"{controls} MB/s"),
        ("share of its mean", f"{result['ratio']:.2f}"),
        ("memory before the first shot", f"{result['before_megabytes']:.0f} MB"),
        ("peak", f"{result['peak_megabytes']:.0f} MB"),
        ("growth of the peak after the third shot", "-" if growth is None else f"{growth:.0f} MB"),
    ]
    return "\n".join(
        [
            "# A capture on its way to the disk",
            "",
            f"`python bench/recording.py --write`: {result['cameras']} cameras x {result['shots']} shots x "
            f"{result['megapixels']:.0f} megapixels, uncompressed DNG. {words(result['machine'])}. `dd` "
            "writes the same to one file and syncs once; the recorder hashes twice and syncs each file.",
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
