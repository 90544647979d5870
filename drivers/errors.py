"""What can go wrong with a camera; each message is one sentence: what, where, the fix.

CameraError (imaging.errors)
├── CameraNotFound     no such camera is connected
├── CameraPermission   the system does not let us open it
├── CameraClaimed      another program holds it
├── CameraLost         it was unplugged or switched off
├── CameraTimeout      it did not answer in time
├── CameraBusy         it answered that it is busy, for longer than we wait
├── CameraRefused      it answered that it cannot or may not do what was asked
└── CameraProtocol     what it sent makes no sense
"""

from imaging.errors import CameraError


class CameraNotFound(CameraError):
    """No such camera is connected."""


class CameraPermission(CameraError):
    """The system does not let us open it."""


class CameraClaimed(CameraError):
    """Another program holds it."""


class CameraLost(CameraError):
    """It was unplugged or switched off."""


class CameraTimeout(CameraError):
    """It did not answer in time."""


class CameraBusy(CameraError):
    """It answered that it is busy, for longer than we wait."""


class CameraRefused(CameraError):
    """It answered that it cannot or may not do what was asked."""


class CameraProtocol(CameraError):
    """What it sent makes no sense."""
