"""`rig capture RIG.toml` from Python: a session shot by the cameras that a rig file names."""

from os import PathLike
from pathlib import Path

from usb.backend import IBackend  # noqa: F401

from capture.connected_rig import Unattended, connected_source
from capture.record.capture_result import CaptureResult
from capture.record.shooting import Say, shoot
from capture.request import RigRequest
from capture.rig_of_nodes import ray_source
from capture.rigfile.rigfile import RigFile
from drivers.gige import Network  # noqa: F401
from imaging.arguments import checked
from imaging.progress import Progress, unreported

_DEFAULTS = RigRequest()  # its quoted types, checked by `checked`, are imported above


@checked
def capture_rig(
    rig: RigFile,
    out: str | PathLike[str],
    request: RigRequest = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    on_message: Say = lambda line: None,
    **options: object,
) -> CaptureResult:
    """Shoot with the connected cameras of a rig file into a session folder.

    Args:
        rig: Rig file, as `read_rig_file` returns it.
        out: Session folder: vacant, or a session of the same cameras.
        request: Options.
        on_progress: Callback for the current step, the steps done, and all of them.
        on_message: Callback for lines that a person should read.
        options: Options by name, in place of those of `request`.

    Returns:
        The shots taken, kept and missing.

    Raises:
        InputError: `out` cannot be used, a camera cannot be triggered as the file says, or there is no such
            cluster.
        CaptureError: A camera or a node is missing, or the scene cannot be metered.
        StorageError: The disk refuses; finished shots stay.
    """
    if request.backend is None and rig.tables.nodes:
        person = request.operator or Unattended()
        described = ray_source(rig, request, request.ray, person=person, clock=request.clock, say=on_message)
    else:
        described = connected_source(rig, request, say=on_message)
    with described as source:
        return shoot(source, Path(out), request, progress=on_progress, say=on_message)
