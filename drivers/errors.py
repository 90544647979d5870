"""Errors of cameras; each message is one sentence: what, where, the fix.

CameraError (imaging.errors)
├── CameraNotFound     no such camera is connected
├── CameraPermission   the system does not let us open it
├── CameraClaimed      another program holds it
├── CameraLost         it was unplugged or switched off
│   └── CameraGone     and did not come back while it was waited for
├── HostLost           the host that it is connected to does not answer
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
    """Disconnection: unplugged or switched off."""


class CameraGone(CameraLost):
    """Disconnection of a camera that did not come back while it was waited for."""


class HostLost(CameraError):
    """Disconnection of the host that the camera is connected to, through no fault of the camera."""


class CameraTimeout(CameraError):
    """Missing answer."""


class CameraBusy(CameraError):
    """Camera busy for longer than the wait allows."""


class CameraRefused(CameraError):
    """Refusal: the camera cannot or may not do what was requested."""


class CameraProtocol(CameraError):
    """Invalid data from the camera."""
