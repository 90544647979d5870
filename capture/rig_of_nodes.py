"""`rig capture RIG.toml` where the file's cameras are connected to several hosts."""

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

from capture.connected_rig import require_board, rig_source
from capture.nodes.clocks import Release
from capture.nodes.cluster import ray_links
from capture.nodes.node import Assignment, NodeReport, Scene, Wire
from capture.nodes.remote import Link, RemoteCamera, RemoteNode, Say, Stage
from capture.record.source import Operator, Source
from capture.request import CaptureRequest
from capture.rigfile.rigfile import RigFile
from capture.rigfile.tables import CameraTable
from drivers.camera import Camera, CameraIdentity
from drivers.clock import Clock, SystemClock
from imaging.choices import Compression, Subject
from imaging.errors import CaptureError, InputError


class OperatorOfNodes:
    """Operator that sets the scene of simulated cameras; a person moves the others, if there are any."""

    def __init__(self, stage: Stage, person: Operator | None) -> None:
        self._stage, self._person = stage, person
        self._next = Scene()

    def show(self, kind: Subject) -> None:
        """Set the subject of the next frame."""
        self._next = replace(self._next, kind=kind)
        if self._person is not None:
            self._person.show(kind)

    def move_to(self, frame: int) -> None:
        """Move."""
        if self._person is not None:
            self._person.move_to(frame)
        self._set(replace(self._next, frame=frame))

    def turn_to(self, band: str) -> None:
        """Turn the filter wheels. InputError: as the person has it."""
        if self._person is not None:
            self._person.turn_to(band)
        self._set(replace(self._next, band=band))

    def _set(self, scene: Scene) -> None:
        self._next = self._stage.scene = replace(scene, number=self._next.number + 1)


def assignments_of(rig: RigFile, compression: Compression = "none") -> dict[str, Assignment]:
    """Return what each node of a rig file has to do."""
    tables = rig.tables
    return {
        node: Assignment(
            serials=tuple(camera.serial for camera in cameras),
            addresses=tuple(camera.address for camera in cameras if camera.address is not None),
            wires={camera.serial: wire for camera in cameras if (wire := _wire(rig, camera)) is not None},
            compression=compression,
        )
        for node in tables.nodes
        if (cameras := [camera for camera in tables.camera if camera.node == node])
    }


def _wire(rig: RigFile, camera: CameraTable) -> Wire | None:
    trigger = rig.tables.trigger
    if trigger.mode != "hardware":
        return None
    assert trigger.line is not None  # the file was validated
    if camera.name == trigger.leader:
        return "drive", trigger.output or trigger.line
    return "listen", trigger.line


@contextmanager
def nodes_source(
    rig: RigFile,
    request: CaptureRequest,
    links: Mapping[str, Link],
    *,
    person: Operator,
    clock: Clock | None = None,
    say: Say = lambda line: None,
) -> Iterator[Source]:
    """Open the cameras of a rig file with nodes.

    Args:
        rig: Rig file.
        request: Options of the capture.
        links: Connection to each node that the file names, left open.
        person: Mover of all that is not simulated.
        clock: Clock of this host; None: the machine's own.
        say: Callback that shows a line that a person should know, such as a camera that the file does not
            name.

    Returns:
        A context manager that gives the cameras as a source, and leaves the links open.

    Raises:
        InputError: A camera cannot be triggered as the file says, it describes no board where one is
            requested, or more frames are asked for than the simulated rigs have positions.
        CaptureError: A camera is not at its node, or cannot shoot.
    """
    require_board(rig, request.kind)
    clock = clock or SystemClock()
    stage = Stage(Release(clock))
    nodes = {name: RemoteNode(name, link, clock, stage, say) for name, link in links.items()}
    with ThreadPoolExecutor(len(nodes)) as pool:
        reports = dict(zip(nodes, pool.map(lambda node: node.ask("report"), nodes.values()), strict=True))
    named = _named(rig, nodes, reports)
    known = {camera.serial for camera in rig.tables.camera}
    for name, report in reports.items():
        for other in report.strangers:
            if other.serial not in known:
                who = f"{other.make} {other.model} {other.serial}"
                say(f"{who} is connected to node {name} and not in {rig.path}.")
    positions = [report.positions for report in reports.values()]
    simulated = [count for count in positions if count is not None]
    all_simulated = len(simulated) == len(positions)
    if all_simulated:
        _require_positions(rig, request, reports)
    operator = OperatorOfNodes(stage, None if all_simulated else person)
    try:
        yield rig_source(rig, named, operator, min(simulated) if all_simulated else None, clock)
    finally:
        for node in nodes.values():
            node.close()


@contextmanager
def ray_source(
    rig: RigFile,
    request: CaptureRequest,
    ray: str,
    *,
    person: Operator,
    clock: Clock | None = None,
    say: Say = lambda line: None,
) -> Iterator[Source]:
    """Open as `nodes_source`, with the nodes of a Ray cluster.

    Args:
        rig: Rig file.
        request: Options of the capture.
        ray: Address of the cluster, HOST:PORT; auto: that of this machine.
        person: Mover of all that is not simulated.
        clock: Clock of this host; None: the machine's own.
        say: Callback that shows a line that a person should know.

    Returns:
        A context manager that gives the cameras as a source, and closes the links to the nodes in the end.

    Raises:
        InputError: There is no such cluster, or as `nodes_source`.
        CaptureError: A node is not there, serves another capture, or as `nodes_source`.
    """
    with (
        ray_links(ray, assignments_of(rig, request.compression)) as links,
        nodes_source(rig, request, links, person=person, clock=clock, say=say) as source,
    ):
        yield source


def _require_positions(rig: RigFile, request: CaptureRequest, reports: Mapping[str, NodeReport]) -> None:
    """InputError unless the simulated rig of each node has as many positions as frames are asked for."""
    asked = rig.tables.frames if request.frames is None else request.frames
    where = f"{rig.path} asks for" if request.frames is None else "the command line asks for"
    for name, report in reports.items():
        if request.kind == "scene" and report.positions is not None and asked > report.positions:
            raise InputError(
                f"{where} {asked} frames, and the simulated rig of node {name} has {report.positions} "
                f"positions: choose 1 to {report.positions}."
            )


def _named(
    rig: RigFile, nodes: Mapping[str, RemoteNode], reports: Mapping[str, NodeReport]
) -> dict[str, tuple[Camera, CameraIdentity]]:
    """The cameras by the names that the file gives them. CaptureError: one is not at its node."""
    named: dict[str, tuple[Camera, CameraIdentity]] = {}
    for index, table in enumerate(rig.tables.camera):
        assert table.node is not None  # the file was validated
        report = reports[table.node]
        served = report.served.get(table.serial)
        if served is None:
            others = sorted([*report.served, *(one.serial for one in report.strangers)])
            there = "; ".join([", ".join(others) or "none", *report.refused])
            raise CaptureError(
                f"{rig.at('camera', index, 'serial')}: {table.name} with the serial number {table.serial!r} "
                f"is not among the cameras of node {table.node} ({there}): connect it, or correct the file."
            )
        if _wire(rig, table) is not None and not served.has_lines:
            raise InputError(
                f"{rig.at('camera', index)}: {table.name} has no lines for a hardware trigger; "
                'set mode = "software" in [trigger].'
            )
        named[table.name] = (RemoteCamera(nodes[table.node], served), served.identity)
    return named
