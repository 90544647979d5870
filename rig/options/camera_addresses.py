"""Cameras on the command line that no search finds: `--camera ptpip:192.168.1.2`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from rig.options.defaults import is_users

if TYPE_CHECKING:
    from capture.rigfile.network_address import NetworkAddress

CameraOption = Annotated[
    list[str] | None,
    typer.Option(
        "--camera",
        metavar="[gphoto2:]ptpip:ADDRESS|gige:ADDRESS",
        help="Also ask the camera at this address: a still camera on Wi-Fi or Ethernet (PTP/IP), or a GigE "
        "Vision camera that no broadcast reaches; repeatable. gphoto2:ptpip:ADDRESS has libgphoto2 drive it.",
    ),
]


def rig_or_addresses(
    context: typer.Context, sim: str | None, camera: Sequence[str] | None
) -> "tuple[str | None, list[NetworkAddress]]":
    """Values of `--sim` and `--camera`; of two that contradict each other, one of the user's file yields."""
    if camera and sim is not None:
        if is_users(context, "camera"):
            camera = None
        elif is_users(context, "sim"):
            sim = None
    return sim, addresses_of(camera, sim)


def addresses_of(given: Sequence[str] | None, sim: str | None) -> "list[NetworkAddress]":
    """Addresses from the option. InputError: one is invalid, or the rig is a simulated one."""
    from capture.rigfile.network_address import address_of
    from imaging.errors import InputError

    if given and sim is not None:
        raise InputError("--camera names a connected camera: leave out --sim, or --camera.")
    addresses = []
    for text in given or ():
        try:
            addresses.append(address_of(text))
        except ValueError as error:
            raise InputError(f"--camera {text!r} has to be {error}.") from None
    return addresses
