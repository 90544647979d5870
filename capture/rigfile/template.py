"""The rig file that `rig init` writes: what is connected, with everything that one may want to change."""

import json
from collections.abc import Sequence

from capture.bracket.goals import BracketGoals
from capture.check.check import SKEW_TOLERANCE
from capture.rigfile.network_address import NetworkAddress
from drivers.discovery import ConnectedCamera
from imaging.errors import CaptureError
from imaging.session.records import Board

EXAMPLE = Board(columns=7, rows=5, square=0.15, marker=0.1125, dictionary="DICT_4X4_50")
"""The board that simulated cameras see."""

_GOALS = BracketGoals()
_HEAD = f"""\
# The rig that `rig capture` shoots with; lines that begin with # say what else there is.
# The command line overrides it: rig capture --help.

frames = 1                  # how often the rig, or the scene, is moved and shot
pause = "key"               # before all frames but the first: "key" waits for Enter, 10 waits 10 seconds

[bracket]
exposures = "auto"          # metered and planned; or stops around a middle exposure: [-4, -2, 0, 2, 4]
# time = "1/60"             # the middle exposure of such stops; metered if not given
{{f_number}}
# iso = 100                 # of such stops; the lowest if not given
snr = {_GOALS.snr}                  # dB that the darkest of the scene has to reach; from here on for "auto"
# slowest = "1/4"           # no exposure longer
# total = 2                 # no bracket longer, all exposures added, in seconds
# highest_iso = 400         # no ISO higher

[trigger]
mode = "software"           # "hardware": exposed by a rising edge on a line; "action": GigE Vision cameras by
                            #   one command over the network, at a time of IEEE 1588 where all keep it
# line = "Line0"            # hardware: the input of the cameras that the edge comes in on
# leader = "{{leader}}"           # hardware: this one is triggered by software, its exposure makes the edge
# output = "Line1"          #   that goes out on this line of it; without a leader edges come from elsewhere
tolerance = {SKEW_TOLERANCE}            # seconds between the shutters of one step that are still together

# [subject]                 # distances from the cameras, in metres, for the plan of rig capture --dry-run:
# nearest = 0.6             #   where to focus, at which f-number, and how far apart to shoot
# farthest = 1.4            #   if not given, all beyond is to be sharp

{{board}}
# A camera is known by its serial number, wherever it is plugged in. Its name stands in the names of its
# files: raw/0000/{{leader}}_0.dng. Cameras that name the same rig are fixed to each other for as long as a
# session is shot; a camera that moves by itself has no rig. With the positions of two cameras in it the scene
# has a scale.
"""


def rig_file_text(
    listed: Sequence[ConnectedCamera], board: Board | None = None, addresses: Sequence[NetworkAddress] = ()
) -> str:
    """RIG.toml for these cameras, by serial number, named cam0, cam1 and so on.

    board: the one that they will be shown, if that is known; else one stands there as an example.
    addresses: those at which cameras were asked by name; they are again when it is shot.
    Those that could not be asked, or cannot shoot, are named in comments. CaptureError if none is left, or
    if two have one serial number.
    """
    able = sorted(
        (camera for camera in listed if not camera.trouble),
        key=lambda camera: camera.identity.serial if camera.identity else "",
    )
    serials = [camera.identity.serial for camera in able if camera.identity]
    if not serials:
        reason = f"can be used ({listed[0].trouble.rstrip('.')})" if listed else "is connected"
        raise CaptureError(f"no camera {reason}: connect the rig; rig doctor shows what is missing.")
    for serial in serials:
        if serials.count(serial) > 1 or not serial:
            raise CaptureError(
                f"{serials.count(serial)} cameras have the serial number {serial!r} and cannot be "
                "distinguished: unplug all but one of them."
            )
    parts = [_HEAD.format(f_number=_f_number(able), leader="cam0", board=_board(board))]
    parts += [
        _camera(f"cam{index}", camera, addresses, alone=len(able) == 1) for index, camera in enumerate(able)
    ]
    parts += [f"\n# Left out: {_printable(camera.trouble)}\n" for camera in listed if camera.trouble]
    return "".join(parts)


def _board(described: Board | None) -> str:
    """The table of a board, in comments if it is but an example."""
    board = EXAMPLE if described is None else described
    lines = (
        "[board]                   # what rig capture --board shows: a ChArUco board, sizes in metres",
        f"columns = {board.columns}               # squares along x, as its generator counts them",
        f"rows = {board.rows}",
        f"square = {board.square:<16g} # its side gives the scene its scale: measure it on the print",
        f"marker = {board.marker:g}",
        f'dictionary = "{board.dictionary}"',
    )
    return "".join(f"{'# ' if described is None else ''}{line}\n" for line in lines)


def _f_number(able: Sequence[ConnectedCamera]) -> str:
    """The f-number next to f/8 that all have: deep focus, hardly any diffraction."""
    first, *others = (set(camera.capabilities.f_numbers) if camera.capabilities else set() for camera in able)
    shared = first.intersection(*others)
    says = "of all exposures, so that sharpness stays"
    if not shared:
        return f"# f_number = 8            # {says}; for lenses that can be set"
    return f"f_number = {min(shared, key=lambda f_number: abs(f_number - 8.0)):<16g} # {says}"


def _camera(name: str, camera: ConnectedCamera, addresses: Sequence[NetworkAddress], *, alone: bool) -> str:
    assert camera.identity is not None
    able = camera.capabilities
    size = f", {able.width} x {able.height}" if able and able.width else ""
    about = f"{camera.identity.make} {camera.identity.model}, {camera.protocol}{size}"
    place = "# position = [0.2, 0.0, 0.0]  # in its rig, in metres, in any axes\n"
    rig = "" if alone else f'rig = "rig"\n{place}'
    band = (
        '# band = "650nm, 650, 40"     # the filter before a mono camera: name, nm of its middle and width\n'
        '# filters = ["450nm, 450, 40", "650nm, 650, 40"]  # of a wheel before it, turned at every frame\n'
    )
    lens = "# focal_length = 8           # of its lens, mm; with the distance between photosites, um:\n"
    lens += (
        "# pixel_pitch = 3.45         #   for the plan of focus, and for rig calibrate if files state none\n"
    )
    named = next((address for address in addresses if camera.where == address.where), None)
    at = "" if named is None else f'address = "{named}"\n'
    table = f"name = {_quoted(name)}\nserial = {_quoted(camera.identity.serial)}\n{at}{rig}{lens}{band}"
    return f"\n[[camera]]  # {_printable(about)}\n{table}"


def _printable(text: str) -> str:
    """Text that ends no comment, whatever a camera says of itself."""
    return "".join(letter if letter.isprintable() else " " for letter in text)


def _quoted(text: str) -> str:
    """A TOML string: that of JSON, but for the one control character that JSON leaves alone."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
