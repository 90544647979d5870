"""Host checks: libusb, permissions, memory for transfers, and programs that hold a camera."""

import os
from dataclasses import dataclass
from pathlib import Path

from drivers.holders import holders, node_of
from drivers.usb import RULES, STILL_IMAGE, U3V_CONTROL, UsbDevice, default_backend, find
from imaging.errors import CameraError

LEAST_MEMORY_MB = 256
"""Memory for USB transfers below which several cameras that stream at once starve each other (Linux: 16)."""

RULES_FOLDERS = (Path("/etc/udev/rules.d"), Path("/usr/lib/udev/rules.d"), Path("/lib/udev/rules.d"))
MEMORY = Path("/sys/module/usbcore/parameters/usbfs_memory_mb")


@dataclass(frozen=True)
class Finding:
    """Result of one check; `fix` is empty if nothing has to be done."""

    name: str
    says: str
    fix: str = ""


def rules_file() -> Path:
    """The udev rules that come with this package."""
    return Path(__file__).with_name(RULES)


def examine() -> list[Finding]:
    """libusb, udev rules, memory for transfers, and every camera on the bus; nothing is opened."""
    backend = default_backend()
    if backend is None:
        fix = "Install libusb 1.0, or the package libusb-package."
        return [Finding("libusb", "not found: no camera can be reached", fix)]
    findings = [Finding("libusb", "found"), _rules(), _memory()]
    try:
        cameras = [device for kind in (STILL_IMAGE, U3V_CONTROL) for device in find(kind, backend)]
    except CameraError as error:
        return [*findings, Finding("USB", str(error), "Connect the machine's USB, or leave the container.")]
    return findings + ([_node(camera) for camera in cameras] or [Finding("cameras", "none on the USB")])


def _rules() -> Finding:
    folders = [folder for folder in RULES_FOLDERS if folder.is_dir()]
    if not folders:
        return Finding("udev rules", "this system has no udev")
    for folder in folders:
        if (folder / RULES).is_file():
            return Finding("udev rules", f"installed in {folder}")
    fix = f"sudo cp {rules_file()} /etc/udev/rules.d/ && sudo udevadm control --reload"
    return Finding("udev rules", "not installed: only root may open cameras", fix)


def _memory() -> Finding:
    try:
        megabytes = int(MEMORY.read_text())
    except (OSError, ValueError):
        return Finding("USB memory", "not limited here, or not known")
    if megabytes == 0 or megabytes >= LEAST_MEMORY_MB:
        return Finding("USB memory", f"{megabytes} MB" if megabytes else "not limited")
    fix = f"echo 1000 | sudo tee {MEMORY}"
    return Finding("USB memory", f"{megabytes} MB: too little for several streaming cameras", fix)


def _node(camera: UsbDevice) -> Finding:
    node = node_of(camera.device)
    if node.exists() and not os.access(node, os.R_OK | os.W_OK):
        fix = f"Install the udev rules ({rules_file()}), then plug the camera in again."
        return Finding(camera.where, "this user may not open it", fix)
    programs = holders(camera.device)
    if programs:
        fix = "Unmount it in the file manager, and close that program."
        return Finding(camera.where, f"held by {', '.join(programs)}", fix)
    return Finding(camera.where, "may be opened")
