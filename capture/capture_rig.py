"""`rig capture RIG.toml` from Python: a session shot by the cameras that a rig file names."""

from os import PathLike
from pathlib import Path

from usb.backend import IBackend

from capture.bracket.planner import BracketGoals
from capture.connected_rig import Unattended, connected_source
from capture.record.capture_run import CaptureResult
from capture.record.shooting import Say, shoot
from capture.record.source import CaptureRequest, Operator, Stops
from capture.rig_of_nodes import ray_source
from capture.rigfile.rigfile import RigFile
from drivers.clock import Clock
from drivers.gige import Network
from imaging.arguments import checked
from imaging.files.tiff.dng import Compression
from imaging.progress import Progress, unreported
from imaging.session.records import Subject


@checked
def capture_rig(
    rig: RigFile,
    out: str | PathLike[str],
    *,
    kind: Subject = "scene",
    frames: int | None = None,
    bracket: Stops | None = None,
    auto: BracketGoals | None = None,
    resume: bool = False,
    compression: Compression = "none",
    operator: Operator | None = None,
    positions: int | None = None,
    backend: IBackend | None = None,
    network: Network | None = None,
    clock: Clock | None = None,
    ray: str = "auto",
    on_progress: Progress = unreported,
    on_message: Say = lambda line: None,
) -> CaptureResult:
    """Shoot with the connected cameras of a rig file into a session folder.

    Args:
        rig: Rig file, as `read_rig_file` returns it.
        out: Session folder: vacant, or a session of the same cameras.
        kind: The scene, or frames for its calibration; None stands for the rig file's value here and below.
        frames: Number of frames.
        bracket: Stops relative to the middle exposure.
        auto: Goals of a bracket that is metered and planned before the first shot.
        resume: Take exactly the shots that `out` lacks.
        compression: Compression of the RAW files.
        operator: Moves rig, scene, lens caps and boards; None: nothing moves.
        positions: Number of positions that the operator offers.
        backend: USB bus of the cameras; None: this machine's.
        network: Network of the cameras; None: this machine's, and those of the nodes in the file.
        clock: Clock of the drivers; None: this machine's.
        ray: HOST:PORT of the cluster that the nodes joined by `rig node`; "auto": this machine's.
        on_progress: Callback for the current step, the steps done, and all of them.
        on_message: Callback for lines that a person should read.

    Returns:
        The shots taken, kept and missing.

    Raises:
        InputError: `out` cannot be used, a camera cannot be triggered as the file says, or there is no such
            cluster.
        CaptureError: A camera or a node is missing, or the scene cannot be metered.
        StorageError: The disk refuses; finished shots stay.
    """
    request = CaptureRequest(kind, frames, bracket if auto is None else auto, resume, compression)
    if backend is None and rig.tables.nodes:
        person = operator or Unattended()
        described = ray_source(rig, request, ray, person=person, clock=clock, say=on_message)
    else:
        described = connected_source(
            rig,
            request,
            operator=operator,
            positions=positions,
            backend=backend,
            network=network,
            clock=clock,
            say=on_message,
        )
    with described as source:
        return shoot(source, Path(out), request, progress=on_progress, say=on_message)
