"""A plug-in for rig: folders into which tethering software drops the RAW files of a camera, a folder each.

RIG_WATCHED="/shots/left:/shots/right" names them. RIG_SHOOT="tether --to {folder} --shutter {time}" has the
software take a picture; without it somebody else does, at the exposure of the newest one there.
"""

import os
import subprocess
from contextlib import suppress
from pathlib import Path

from drivers.camera import Camera, CameraFile, CameraIdentity, Capabilities
from drivers.clock import Clock
from drivers.errors import CameraRefused, CameraTimeout
from imaging.errors import InputError
from imaging.files.raw import is_raw, read_raw_header, read_raw_metadata
from imaging.optics.exposure import Exposure

WATCHED, SHOOT = os.environ.get("RIG_WATCHED", ""), os.environ.get("RIG_SHOOT", "")
TIMES = tuple(2.0 ** (step / 3) for step in range(-36, 16))  # 1/4096 s to 32 s
PATIENCE, LOOK = 60.0, 0.25  # seconds: for a file to come, and for which none may change before it is read


class WatchedFolder:
    def __init__(self, where: str, clock: Clock) -> None:
        self.where, self._dir, self._clock = where, Path(where), clock
        self._time, self._before, self._ends = 0.0, None, 0.0

    def verified(self) -> str:
        return "a program that stands for tethering software"

    def identify(self) -> CameraIdentity:
        return CameraIdentity(self._dir.name, "Watched", "folder", "raw")

    def capabilities(self) -> Capabilities:
        newest = None if SHOOT else max(self._settled(), default=None)
        settings = None if newest is None else read_raw_metadata(newest[1]).exposure
        times = TIMES if SHOOT else (settings.time,) if settings else ()
        return Capabilities(0, 0, 0, times, (), (), "" if times else "its folder has no RAW file yet")

    def set_exposure(self, exposure: Exposure) -> Exposure:
        self._time = min(self.capabilities().times, key=lambda one: abs(one - exposure.time), default=1.0)
        self._before, self._ends = None, 0.0
        return Exposure(time=self._time)

    def arm(self) -> None:
        self._before, self._ends = self._settled(), 0.0

    def trigger(self) -> float:
        if self._before is None or self._ends:
            raise CameraRefused(f"{self.where} is not armed: set an exposure and arm it first.")
        self._ends = (opened := self._clock.now()) + self._time + PATIENCE
        if SHOOT and subprocess.run(SHOOT.format(folder=self.where, time=self._time), shell=True).returncode:
            raise CameraRefused(f"{self.where} gets no picture: run RIG_SHOOT by hand.")
        return opened

    def collect(self) -> CameraFile:
        while self._clock.now() < self._ends:
            came = [path for _, path in self._settled() - self._before]
            if len(came) > 1:
                raise CameraRefused(f"{self.where} got {len(came)} RAW files for a shot: switch bursts off.")
            with suppress(InputError, IndexError):  # it, or the rest of it, is still to come
                data, kind = came[0].read_bytes(), came[0].suffix.lower()
                raw, self._before, self._ends = read_raw_header(data, kind), None, 0.0
                return CameraFile(data, kind, raw.width, raw.height, raw.metadata, raw.white.bit_length())
        raise CameraTimeout(f"{self.where} got no whole RAW file: have the software save RAW files there.")

    def close(self) -> None:
        self._before, self._ends = None, 0.0

    def _settled(self) -> set[tuple[int, Path]]:
        listing = None
        while listing != (listing := {(f.stat().st_mtime_ns, f) for f in self._dir.glob("*") if is_raw(f)}):
            self._clock.sleep(LOOK)
        return listing


def find_cameras(clock: Clock) -> list[Camera]:
    return [WatchedFolder(folder, clock) for folder in WATCHED.split(os.pathsep) if folder]
