"""A camera of a few pixels that does what it is told, or exactly the wrong thing at the n-th time."""

import hashlib
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from capture.record.recorder import record
from drivers.camera import CameraFile, CameraIdentity, Capabilities
from imaging.errors import CameraError
from imaging.files.photo import encode_jpeg
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.records import CameraRecord, PlanRecord, SessionRecord
from imaging.session.session import Session

WHEN = datetime(2026, 3, 1, 12, 0, 0)
BRACKET = (Exposure(time=1 / 8, iso=100), Exposure(time=1 / 32, iso=100), Exposure(time=1 / 128, iso=100))


class FakeCamera:
    """Pixels follow from serial, frame and exposure alone. Faults: {(operation, nth call from 1): fault}.

    A fault is an exception to raise, or for "set_exposure" and "collect" an exposure to report instead.
    """

    def __init__(self, serial: str, kind: str = "raw") -> None:
        self.serial = serial
        self.kind = kind
        self.frame = 0
        self.clock = 100.0
        self.calls: list[str] = []
        self.faults: dict[tuple[str, int], Exception | Exposure] = {}
        self.vanished = False
        self.setting = BRACKET[0]
        self.log: list[tuple[str, str]] = []
        """Shared between the cameras of a rig: (operation, serial) in order."""

    def _called(self, operation: str) -> Exposure | None:
        self.calls.append(operation)
        self.log.append((operation, self.serial))
        fault = self.faults.get((operation, self.calls.count(operation)))
        if self.vanished:
            raise CameraError(f"camera {self.serial} is gone: plug it in again.")
        if isinstance(fault, Exception):
            raise fault
        return fault

    def identify(self) -> CameraIdentity:
        return CameraIdentity(self.serial, "Fake", "F1", self.kind)  # type: ignore[arg-type]

    def capabilities(self) -> Capabilities:
        times = tuple(2.0**n for n in range(-12, 4))
        return Capabilities(32, 24, 12, times, (4.0,), (100.0,))

    stamp: float | None = None
    stamps = True
    """True if its frames state their exposure."""

    def set_exposure(self, exposure: Exposure) -> Exposure:
        wrong = self._called("set_exposure")
        self.setting = wrong or exposure
        return self.setting

    def arm(self) -> None:
        self._called("arm")

    def trigger(self) -> float:
        self._called("trigger")
        self.clock += 1.0
        self.stamp = self.clock
        return self.clock

    def collect(self) -> RawMosaic | CameraFile:
        reported = self._called("collect") or self.setting
        digest = hashlib.sha256(f"{self.serial} {self.frame} {self.setting.time!r}".encode()).digest()
        pixels = np.random.default_rng(list(digest)).integers(0, 4096, (24, 32), dtype=np.uint16)
        metadata = FrameMetadata(
            make="Fake",
            model="F1",
            serial=self.serial,
            exposure=reported,
            captured_at=WHEN + timedelta(seconds=self.frame),
            opened=self.stamp if self.stamps else None,
        )
        if self.kind == "ldr":
            codes = np.repeat((pixels >> 4).astype(np.uint8)[..., None], 3, axis=2)
            return CameraFile(encode_jpeg(codes, metadata=metadata), ".jpg", 32, 24, metadata)
        return RawMosaic(pixels, Cfa.RGGB, ((64.0,),), 4095, metadata=metadata)

    def close(self) -> None:
        self._called("close")


class FakeRig:
    """Cameras A and B (or as named), three frames, a bracket of three; and a session to put them in."""

    def __init__(self, folder: Path, kinds: dict[str, str]) -> None:
        self.cameras = {name: FakeCamera(f"serial-{name}", kind) for name, kind in kinds.items()}
        self.log: list[tuple[str, str]] = []
        for offset, camera in enumerate(self.cameras.values()):
            camera.clock += offset * 0.004
            camera.log = self.log
        self.plan = PlanRecord(
            plan="scene",
            kind="scene",
            created=WHEN,
            bracket=BRACKET,
            frames=(0, 1, 2),
            cameras=tuple(kinds),
            reason="test",
        )
        records = tuple(
            CameraRecord(name=name, serial=f"serial-{name}", kind=kind)  # type: ignore[arg-type]
            for name, kind in kinds.items()
        )
        self.session = Session.create(
            folder, SessionRecord(name="fake", created=WHEN, origin="test", cameras=records)
        )
        self.session.append_plan(self.plan)

    def move_to(self, frame: int) -> None:
        for camera in self.cameras.values():
            camera.frame = frame


@pytest.fixture
def fake_rig(tmp_path: Path) -> Callable[..., FakeRig]:
    def make(name: str = "session", **kinds: str) -> FakeRig:
        return FakeRig(tmp_path / name, kinds or {"a": "raw", "b": "ldr"})

    return make


@pytest.fixture
def rig(fake_rig: Callable[..., FakeRig]) -> FakeRig:
    """One RAW camera and one that develops its pictures, with everything shot."""
    rig = fake_rig(a="raw", b="ldr")
    record(rig.session, rig.plan, rig.cameras, move_to=rig.move_to)
    return rig
