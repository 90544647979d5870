"""libgphoto2, as the wheel gphoto2 has it: whether it is there, what it finds, and its errors as ours."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

from drivers.errors import (
    CameraBusy,
    CameraClaimed,
    CameraLost,
    CameraPermission,
    CameraRefused,
    CameraTimeout,
)
from imaging.errors import CameraError

SCHEME = "gphoto2:"
"""Prefix of a port of libgphoto2 in a camera's name: `gphoto2:ptpip:192.168.1.2`."""
INSTALL = "pip install -e '.[gphoto2]'"

_ERRORS: dict[int, tuple[type[CameraError], str]] = {
    -1: (CameraRefused, "check its focus, its card and its cable"),
    -5: (CameraLost, "plug it in, or see that the network has it"),
    -6: (CameraRefused, "use another body, or its own tethering program"),
    -7: (CameraLost, "check its cable and its battery, and switch it off and on"),
    -10: (CameraTimeout, "check focus, card and battery, and take the shot again"),
    -52: (CameraLost, "plug it in, and switch it on"),
    -53: (CameraClaimed, "unmount it in the file manager, and close other programs that use it"),
    -60: (CameraClaimed, "close the other program that uses it"),
    -82: (CameraPermission, "install the udev rules, as rig doctor says, and plug it in again"),
    -105: (CameraLost, "plug it in, and switch it on"),
    -110: (CameraBusy, "wait until it has stored its pictures"),
}
"""Errors by the codes of gphoto2-result.h and gphoto2-port-result.h: the message, and the fix."""


def is_installed() -> bool:
    """Return whether the package gphoto2 is."""
    return find_spec("gphoto2") is not None


def library() -> Any:
    """The module gphoto2. CameraRefused: it is not installed."""
    try:
        import gphoto2
    except ImportError as error:
        raise CameraRefused(f"libgphoto2 is not installed: {INSTALL}.") from error
    return gphoto2


def detected() -> list[tuple[str, str]]:
    """Model and port of each camera on the USB that libgphoto2 can trigger, none of them opened."""
    gp = library()
    with errors_translated("libgphoto2"):
        models = gp.CameraAbilitiesList()
        models.load()
        cameras = gp.Camera.autodetect()
        listed = [(str(cameras.get_name(at)), str(cameras.get_value(at))) for at in range(cameras.count())]
        able = [
            (model, port)
            for model, port in listed
            if port.startswith("usb:")
            and models[models.lookup_model(model)].operations & gp.GP_OPERATION_CAPTURE_IMAGE
        ]
    return sorted(able, key=lambda one: one[1])


@contextmanager
def errors_translated(where: str) -> Iterator[None]:
    """Errors of libgphoto2 as CameraErrors of one sentence; `where` names the camera."""
    gp = library()
    try:
        yield
    except gp.GPhoto2Error as error:
        kind, fix = _ERRORS.get(error.code, (CameraRefused, "switch the camera off and on"))
        raise kind(f"{where} answers {str(error.string).lower()!r} through libgphoto2: {fix}.") from error
