"""`rig capture RIG.toml` where the file's cameras are connected to this machine."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from capture.bracket.exposure_choices import common_isos
from capture.record.shooting import Say, nothing_beside
from capture.record.source import Operator, Source
from capture.request import RigRequest
from capture.rigfile.network_address import gige_hosts, ptpip_places
from capture.rigfile.rigfile import RigFile
from drivers.camera import Camera, CameraIdentity, HardwareTriggered
from drivers.clock import Clock, SystemClock
from drivers.discovery import find_cameras
from drivers.gige import ActionTeam, GigeCamera, Network
from drivers.usb import default_backend
from imaging.choices import Subject
from imaging.errors import CameraError, CaptureError, InputError
from imaging.session.records import CameraRecord


class Unattended:
    """Operator of an unattended rig, which moves nothing."""

    def show(self, kind: Subject) -> None:
        """Leave what the cameras see as it is."""

    def move_to(self, frame: int) -> None:
        """Leave the rig where it is."""

    def turn_to(self, band: str) -> None:
        """InputError: pictures through another filter would be taken for this one's."""
        raise InputError(f"no operator turns the filter wheel to {band}: name an operator who does.")


AGREEMENT = 30.0
"""Seconds that cameras are given to agree on a time; they need some rounds of one or two seconds."""


def require_board(rig: RigFile, kind: Subject) -> None:
    """InputError where a board is to be shown that nothing describes: no calibration could use the shots."""
    if kind == "board" and rig.tables.board is None:
        from capture.rigfile.template import EXAMPLE  # a board takes OpenCV, which takes a while to load

        example = ", ".join(f"{key} = {json.dumps(value)}" for key, value in EXAMPLE.model_dump().items())
        raise InputError(
            f"{rig.path} does not describe the board that is shown: make `board = {{ {example} }}` its first "
            "line, with the squares and the sizes in metres of your own, or fill in its [board] table."
        )


@contextmanager
def connected_source(
    rig: RigFile,
    request: RigRequest,
    *,
    say: Say = lambda line: None,
) -> Iterator[Source]:
    """Open the cameras of a rig file, and close them in the end.

    InputError: a camera cannot be triggered as the file says, or it describes no board where one is
    requested. CaptureError: a camera is not there.
    """
    require_board(rig, request.kind)
    clock, backend, network = request.clock or SystemClock(), request.backend, request.network
    if backend is None:
        backend, network = default_backend(), network or Network(gige_hosts(rig.tables.addresses))
    # A simulated bus stands in for the network too.
    places = () if network is None else ptpip_places(rig.tables.addresses)
    cameras = find_cameras(backend, clock, network, places)
    try:
        named, strangers = _identified(rig, cameras)
        for identity in strangers:
            say(f"{identity.make} {identity.model} {identity.serial} is connected and not in {rig.path}.")
        _wire(rig, {name: camera for name, (camera, _) in named.items()}, clock, say)
        yield rig_source(rig, named, request.operator or Unattended(), request.positions, clock)
    finally:
        for camera in cameras:
            camera.close()


def rig_source(
    rig: RigFile,
    named: Mapping[str, tuple[Camera, CameraIdentity]],
    operator: Operator,
    positions: int | None,
    clock: Clock,
) -> Source:
    """Source with cameras by the names in the file.

    Args:
        rig: Rig file.
        named: Camera and identity by the name in the file, of every camera that it lists.
        operator: Mover of rig, scene, lens caps and boards.
        positions: Number of positions that the operator offers; None: unlimited.
        clock: Clock of the cameras' drivers.

    Returns:
        The cameras, with the bracket, trigger, board and filters of the file.

    Raises:
        CaptureError: A camera cannot shoot.
        CameraError: A camera does not report what it can be set to.
    """
    tables = rig.tables
    cameras = {name: camera for name, (camera, _) in named.items()}
    able = {name: camera.capabilities() for name, camera in cameras.items()}
    for index, table in enumerate(tables.camera):
        if obstacle := able[table.name].obstacle:
            raise CaptureError(
                f"{rig.at('camera', index)}: {table.name} with the serial number {table.serial!r} cannot "
                f"shoot for rig ({obstacle}): take it out of the file."
            )
    lowest = common_isos(able.values())[0]
    records = tuple(
        CameraRecord(
            name=table.name,
            serial=table.serial,
            make=named[table.name][1].make,
            model=named[table.name][1].model,
            kind=named[table.name][1].kind,
            rig=table.rig,
            position=table.position,
            band=None if table.band is None else table.band.name,
            focal_length=table.focal_length,
            pixel_pitch=table.pixel_pitch,
        )
        for table in tables.camera
    )
    bracket = tables.bracket
    return Source(
        called=str(rig.path),
        origin=rig.path.name,
        seed=None,
        records=records,
        cameras=cameras,
        clock=clock,
        operator=operator,
        bracket=bracket.wanted if bracket.exposures == "auto" else bracket.exposures,
        middle=bracket.middle(lowest),
        f_number=bracket.f_number,
        iso=bracket.iso,
        positions=positions,
        frames=tables.frames,
        leader=tables.leader,
        tolerance=tables.trigger.tolerance,
        size=None,
        board=tables.board,
        beside=nothing_beside,
        pixels={name: one.width * one.height for name, one in able.items()},
        bands=tables.bands,
        wheel=tuple(band.name for band in tables.wheel),
    )


def _identified(
    rig: RigFile, cameras: Sequence[Camera]
) -> tuple[dict[str, tuple[Camera, CameraIdentity]], list[CameraIdentity]]:
    """The cameras by the names that the file gives their serial numbers, and those that it does not name.

    CaptureError if one is not there, or two have the serial number of one.
    """
    by_serial: dict[str, tuple[Camera, CameraIdentity]] = {}
    refused: list[str] = []
    for camera in cameras:
        try:
            identity = camera.identify()
        except CameraError as error:
            refused.append(str(error).rstrip("."))
            continue
        if identity.serial in by_serial:
            raise CaptureError(
                f"two cameras have the serial number {identity.serial!r} and cannot be distinguished: "
                "unplug one of them."
            )
        by_serial[identity.serial] = (camera, identity)
    by_name: dict[str, tuple[Camera, CameraIdentity]] = {}
    for index, table in enumerate(rig.tables.camera):
        if table.serial not in by_serial:
            there = "; ".join([", ".join(sorted(by_serial)) or "none", *refused])
            raise CaptureError(
                f"{rig.at('camera', index, 'serial')}: {table.name} with the serial number {table.serial!r} "
                f"is not among the connected cameras ({there}): connect it, or correct the file."
            )
        by_name[table.name] = by_serial[table.serial]
    named = {table.serial for table in rig.tables.camera}
    return by_name, [identity for serial, (_, identity) in sorted(by_serial.items()) if serial not in named]


def _wire(rig: RigFile, cameras: Mapping[str, Camera], clock: Clock, say: Say) -> None:
    """Configure triggering from the rig file; InputError if a camera lacks trigger lines or action
    commands.
    """
    trigger = rig.tables.trigger
    if trigger.mode == "software":
        return
    if trigger.mode == "action":
        _team_up(rig, cameras, clock, say)
        return
    assert trigger.line is not None  # the file was validated
    for index, table in enumerate(rig.tables.camera):
        camera = cameras[table.name]
        if not isinstance(camera, HardwareTriggered):
            raise InputError(
                f"{rig.at('camera', index)}: {table.name} has no lines for a hardware trigger; "
                'set mode = "software" in [trigger].'
            )
        if table.name == trigger.leader:
            camera.drive(trigger.output or trigger.line)
        else:
            camera.listen(trigger.line)


def _team_up(rig: RigFile, cameras: Mapping[str, Camera], clock: Clock, say: Say) -> None:
    """Let all cameras expose on the command of the leading one; InputError if one is on no network."""
    team = ActionTeam()
    members: dict[str, GigeCamera] = {}
    for index, table in enumerate(rig.tables.camera):
        camera = cameras[table.name]
        if not isinstance(camera, GigeCamera):
            raise InputError(
                f"{rig.at('camera', index)}: {table.name} is no GigE Vision camera and takes no commands "
                'over the network; set mode = "software" in [trigger].'
            )
        members[table.name] = camera
    for name, camera in members.items():
        camera.join(team, leads=name == rig.tables.leader)
    deadline = clock.now() + AGREEMENT
    alone = [
        name for name, camera in members.items() if not camera.wait_for_time(max(deadline - clock.now(), 0.0))
    ]
    if alone:
        say(
            f"No common time (IEEE 1588) with {', '.join(alone)}: the cameras are triggered at once, and how "
            "far apart their shutters open is known to a millisecond or so."
        )
