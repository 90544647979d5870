"""A plug-in for rig: the camera of a Raspberry Pi, by `rpicam-still` (package rpicam-apps).

    pip install examples/plugin
    rig cameras
    rig doctor --camera rpicam-0

It has been tried on a stand-in of `rpicam-still`, not on a Raspberry Pi.
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

from drivers.camera import Camera, CameraFile, CameraIdentity, Capabilities
from drivers.clock import Clock
from drivers.errors import CameraRefused
from imaging.files.raw import read_raw_header
from imaging.optics.exposure import Exposure

PROGRAM = "rpicam-still"
TIMES = tuple(2.0 ** (step / 3) for step in range(-36, 4))  # 1/4096 s to 2 s
ISOS = (100.0, 200.0, 400.0, 800.0)


class RpiCamera:
    where = PROGRAM

    def __init__(self, number: int, clock: Clock) -> None:
        self._number, self._clock = number, clock
        self._exposure: Exposure | None = None
        self._armed, self._frame = False, b""

    def verified(self) -> str:
        return "a program that stands for rpicam-still"

    def identify(self) -> CameraIdentity:
        return CameraIdentity(f"rpicam-{self._number}", "Raspberry Pi", "camera", "raw")

    def capabilities(self) -> Capabilities:
        return Capabilities(width=0, height=0, bit_depth=0, times=TIMES, f_numbers=(), isos=ISOS)

    def set_exposure(self, exposure: Exposure) -> Exposure:
        time = min(TIMES, key=lambda one: abs(one / exposure.time - 1))
        iso = min(ISOS, key=lambda one: abs(one - (exposure.iso or ISOS[0])))
        self._exposure, self._armed, self._frame = Exposure(time=time, iso=iso), False, b""
        return self._exposure

    def arm(self) -> None:
        self._armed = True

    def trigger(self) -> float:
        if not self._armed or self._exposure is None:
            raise CameraRefused("rpicam-still is not armed: set an exposure and arm it first.")
        self._armed, opened = False, self._clock.now()
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder, "frame.jpg")  # --raw writes frame.dng beside it
            microseconds, gain = round(1e6 * self._exposure.time), self._exposure.iso_gain
            command = [PROGRAM, "--camera", str(self._number), "--raw", "--nopreview", "--immediate"]
            command += ["--shutter", str(microseconds), "--gain", f"{gain:g}", "--output", str(out)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode or not out.with_suffix(".dng").is_file():
                says = (done.stderr.splitlines() or ["it says nothing"])[-1]
                raise CameraRefused(f"rpicam-still took no picture ({says}): try it by hand.")
            self._frame = out.with_suffix(".dng").read_bytes()
        return opened

    def collect(self) -> CameraFile:
        if not self._frame:
            raise CameraRefused("rpicam-still has no frame: trigger it first.")
        data, self._frame = self._frame, b""
        head = read_raw_header(data, ".dng")
        return CameraFile(data, ".dng", head.width, head.height, head.metadata, head.white.bit_length())

    def close(self) -> None:
        self._armed, self._frame = False, b""


def find_cameras(clock: Clock) -> list[Camera]:
    return [RpiCamera(0, clock)] if shutil.which(PROGRAM) else []
