"""A node: the cameras of one host, driven as the host that leads asks, their frames kept on its disk."""

import hashlib
import itertools
import math
import re
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from capture.nodes.node_settings import Place
from capture.rigfile.network_address import NetworkAddress, gige_hosts, ptpip_places
from drivers.camera import (
    Camera,
    CameraFile,
    CameraIdentity,
    Capabilities,
    HardwareTriggered,
    StoresShots,
)
from drivers.discovery import find_cameras
from drivers.errors import CameraLost, CameraProtocol, CameraRefused
from drivers.gige import Network
from imaging.choices import Compression, Subject
from imaging.errors import CameraError, CaptureError, StorageError
from imaging.files import store
from imaging.files.tiff.dng import dng_pieces
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata, RawMosaic

LATEST = 0.1
"""Seconds that a trigger is held back at most, twice as long as it is sent ahead: a moment further away is
that of a clock that has jumped."""
SHOT = re.compile(r"shot-\d{6,}-[0-9a-f]{8}\.\w+|\.shot-\d{6,}-[0-9a-f]{8}\.\w+\.part")
"""Name of a node's file, whole or half-written: by it leftovers of another capture are removed, and nothing
else that lies on the disk."""

Wire = tuple[Literal["listen", "drive"], str]


@dataclass(frozen=True)
class Assignment:
    """Task of a node in a capture. serials: of its cameras; addresses: of cameras that discovery cannot find.


    wires: what cameras do with a line. compression: of the DNG files that it makes of mosaics.
    """

    serials: tuple[str, ...]
    addresses: tuple[NetworkAddress, ...] = ()
    wires: Mapping[str, Wire] = field(default_factory=dict)
    compression: Compression = "none"


@dataclass(frozen=True)
class ServedCamera:
    """A camera as its node found it. has_lines: for a hardware trigger."""

    identity: CameraIdentity
    capabilities: Capabilities
    where: str
    verified: str
    has_lines: bool


@dataclass(frozen=True)
class NodeReport:
    """State of a node. served: by serial number, those requested; strangers: others; refused: why.

    positions: of a simulated rig; None: a person moves the cameras.
    """

    served: Mapping[str, ServedCamera]
    strangers: tuple[CameraIdentity, ...]
    refused: tuple[str, ...]
    positions: int | None


@dataclass(frozen=True)
class Scene:
    """Scene for simulated cameras. number: of the move; a new one counts exposures anew."""

    number: int = 0
    kind: Subject = "scene"
    frame: int = 0
    band: str | None = None


@dataclass(frozen=True)
class NodeFile:
    """A file on a node's disk, and the hash of the bytes that it was meant to hold."""

    path: Path
    sha256: str

    @property
    def suffix(self) -> str:
        """Suffix as in `CameraFile`."""
        return self.path.suffix


@dataclass(frozen=True)
class NodeFrame:
    """A frame on a node's disk: its file, and the photograph beside it, if there is one.

    The rest as in `CameraFile`.
    """

    file: NodeFile
    developed: NodeFile | None
    width: int
    height: int
    bit_depth: int
    metadata: FrameMetadata
    proven: bool


class Node:
    """The cameras of a node for one capture; every method may be called from several threads."""

    def __init__(self, place: Place, assignment: Assignment) -> None:
        self._place, self._assignment = place, assignment
        self._cameras: dict[str, Camera] | None = None
        self._report: NodeReport | None = None
        self._finding = False
        """True while a thread searches for the cameras; others wait for it on the clock."""
        self._scene: Scene | None = None
        self._numbers = itertools.count()
        self._in_camera: dict[int, Any] = {}
        self._on_disk: dict[int, NodeFrame] = {}
        self._lock = threading.Lock()

    def now(self) -> float:
        """The time of the clock that its drivers have, s."""
        return self._place.clock.now()

    def report(self) -> NodeReport:
        """Find the cameras; those that are asked for stay open. CaptureError: two have one serial number."""
        clock = self._place.clock
        while self._report is None:
            with clock.lock:
                others, self._finding = self._finding, True
            if others:
                clock.wait(lambda: not self._finding, math.inf)
                continue
            try:
                self._report = self._report_now()
            finally:
                with clock.lock:
                    self._finding = False
                    clock.changed()
        return self._report

    def set_exposure(self, serial: str, exposure: Exposure) -> Exposure:
        """Set the camera."""
        return self._camera(serial).set_exposure(exposure)

    def arm(self, serial: str, scene: Scene | None) -> None:
        """Arm the camera, before that scene if it is a simulated one."""
        camera = self._camera(serial)
        with self._lock:
            self._show(scene)
        camera.arm()

    def trigger(self, serial: str, at: float) -> float:
        """Expose at that time of the node's clock, or at once if it has passed; when the shutter opened."""
        camera, clock = self._camera(serial), self._place.clock
        clock.sleep(min(max(0.0, at - clock.now()), LATEST))
        return camera.trigger()

    def keep(self, serial: str) -> int:
        """Wait until the frame is in the camera's store or else on this disk; the number that it has then."""
        camera = self._camera(serial)
        number = next(self._numbers)
        if isinstance(camera, StoresShots) and camera.keeps():
            self._in_camera[number] = camera.keep()
        else:
            self._on_disk[number] = self._stored(camera.collect(), serial, number)
        return number

    def store(self, serial: str, number: int) -> NodeFrame:
        """Store a frame on this disk, and return its place. CameraLost if the node was restarted since.
        CameraLost: this node was started after it was taken.
        """
        camera = self._camera(serial)
        if number in self._in_camera:
            assert isinstance(camera, StoresShots)
            frame = camera.fetch(self._in_camera[number])
            self._on_disk[number] = self._stored(frame, serial, number)
            del self._in_camera[number]
        if number not in self._on_disk:
            raise CameraLost(f"node {self._place.name} was restarted after the shot: take it again.")
        return self._on_disk[number]

    def read(self, file: NodeFile) -> bytes:
        """The bytes of such a file. CameraProtocol: the disk does not give it back."""
        try:
            return file.path.read_bytes()
        except OSError as error:
            raise CameraProtocol(f"node {self._place.name} lost {file.path} ({error.strerror}).") from None

    def drop(self, number: int) -> None:
        """Remove a frame that has arrived where it is wanted."""
        frame = self._on_disk.pop(number, None)
        for file in (frame.file, frame.developed) if frame else ():
            if file is not None:
                with suppress(StorageError):  # the next capture removes it
                    store.discard(file.path)

    def close(self) -> None:
        """Let go of the cameras, and remove what is left of their frames."""
        for camera in (self._cameras or {}).values():
            camera.close()
        for number in list(self._on_disk):
            self.drop(number)

    def _report_now(self) -> NodeReport:
        place, assignment = self._place, self._assignment
        addresses = (*place.addresses, *assignment.addresses)
        network = None
        if place.rig is None or addresses:
            network = Network(gige_hosts(addresses), None if place.rig is None else [])
        for leftover in place.disk.glob("*shot-*"):
            if SHOT.fullmatch(leftover.name) and leftover.is_file():
                store.discard(leftover)
        cameras: dict[str, Camera] = {}
        served: dict[str, ServedCamera] = {}
        strangers, refused = [], []
        for camera in find_cameras(place.backend, place.clock, network, ptpip_places(addresses)):
            try:
                identity = camera.identify()
                if identity.serial not in assignment.serials:
                    strangers.append(identity)
                    camera.close()
                    continue
                if identity.serial in cameras:
                    raise CaptureError(
                        f"node {place.name} has two cameras with the serial number {identity.serial!r}, "
                        "which cannot be distinguished: unplug one of them."
                    )
                served[identity.serial] = self._taken(camera, identity)
                cameras[identity.serial] = camera
            except CameraError as error:
                refused.append(str(error).rstrip("."))
                camera.close()
        self._cameras = cameras
        positions = None if place.rig is None or not self._simulates_all(cameras) else place.rig.frames
        return NodeReport(served, tuple(strangers), tuple(refused), positions)

    def _taken(self, camera: Camera, identity: CameraIdentity) -> ServedCamera:
        """Open a camera and configure its lines."""
        has_lines = isinstance(camera, HardwareTriggered)
        wire = self._assignment.wires.get(identity.serial)
        if wire is not None and isinstance(camera, HardwareTriggered):
            (camera.listen if wire[0] == "listen" else camera.drive)(wire[1])
        return ServedCamera(identity, camera.capabilities(), camera.where, camera.verified(), has_lines)

    def _simulates_all(self, cameras: Mapping[str, Camera]) -> bool:
        assert self._place.rig is not None
        return set(cameras) <= {device.body.serial for device in self._place.rig.devices}

    def _camera(self, serial: str) -> Camera:
        """CameraLost if it is not here, as when the node was started again without it."""
        self.report()
        assert self._cameras is not None
        if serial not in self._cameras:
            raise CameraLost(f"camera {serial} is not connected to node {self._place.name}: connect it.")
        return self._cameras[serial]

    def _show(self, scene: Scene | None) -> None:
        """Set the scene of simulated cameras, if it is not set yet."""
        rig, before = self._place.rig, self._scene
        if rig is None or scene is None or scene == before:
            return
        if scene.kind != (before.kind if before else "scene"):
            rig.show(scene.kind)
        if scene.band is not None:
            rig.turn_to(scene.band)
        rig.move_to(scene.frame)
        self._scene = scene

    def _stored(self, frame: RawMosaic | CameraFile, serial: str, number: int) -> NodeFrame:
        """Write a frame: a camera's file as it is, a mosaic as DNG. CameraRefused: the disk refuses it."""
        name = f"shot-{number:06d}-{hashlib.sha256(serial.encode()).hexdigest()[:8]}"
        # Where the camera has no clock, ours gives the time; its file then says nothing, as without nodes.
        metadata = replace(frame.metadata, captured_at=frame.metadata.captured_at or datetime.now(UTC))
        try:
            if isinstance(frame, RawMosaic):
                height, width = frame.pixels.shape[:2]
                pieces = dng_pieces(frame, self._assignment.compression)
                file = self._written(f"{name}.dng", pieces)
                return NodeFrame(file, None, width, height, frame.white.bit_length(), metadata, proven=True)
            developed = None
            if frame.developed is not None:
                developed = self._written(f"{name}{frame.developed[0]}", [frame.developed[1]])
            file = self._written(f"{name}{frame.suffix}", [frame.data])
        except StorageError as error:
            raise CameraRefused(f"the disk of node {self._place.name} is in the way: {error}") from error
        return NodeFrame(
            file, developed, frame.width, frame.height, frame.bit_depth, metadata, proven=frame.proven
        )

    def _written(self, name: str, pieces: list[bytes | memoryview]) -> NodeFile:
        digest = hashlib.sha256()
        for piece in pieces:
            digest.update(piece)
        path = self._place.disk / name
        store.write_pieces(path, pieces)
        return NodeFile(path, digest.hexdigest())
