"""The errors that a user may see; each message is one sentence: what, where, how to fix it.

    RigError                exit 2: the input or the usage is at fault, nothing usable came out
    ├── InputError          a file, folder or option that cannot be used
    ├── StorageError        the disk refused: full, read-only, no permission
    ├── PartialError        exit 3: done in part, what is there stays
    ├── CameraError         (drivers) a camera failed to carry out an order
    ├── CaptureError        (capture)
    ├── CalibrationError    (calib)
    └── ReconstructionError (recon)

Anything else that reaches the command line is a bug in rig (exit 1).
"""

from typing import ClassVar


class RigError(Exception):
    """Base of every error that `rig` raises on purpose."""

    exit_code: ClassVar[int] = 2


class InputError(RigError):
    """A file, a folder or an option cannot be used as given."""


class StorageError(RigError):
    """The disk refused a write: full, read-only or not permitted."""


class PartialError(RigError):
    """The work is done in part; what is there stays, and the message lists what is missing."""

    exit_code: ClassVar[int] = 3


class CameraError(RigError):
    """Failure of a camera to carry out an order."""


class CaptureError(RigError):
    """A capture could not be planned, begun or finished."""


class CalibrationError(RigError):
    """A calibration is not possible from what the session holds."""


class ReconstructionError(RigError):
    """A scene cannot be trained, rendered or evaluated from what is there."""
