"""Programs that hold a USB device open, as Linux shows them."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

NODES = Path("/dev/bus/usb")
PROCESSES = Path("/proc")


def node_of(device: Any) -> Path:
    """Device file on Linux."""
    return NODES / f"{device.bus or 0:03d}" / f"{device.address or 0:03d}"


def holders(device: Any) -> list[str]:
    """Names of other programs that have the device open, as far as this user may see them."""
    node, names = str(node_of(device)), set()
    for process in _numbered(PROCESSES):
        if process.name == str(os.getpid()):
            continue
        try:
            if any(os.readlink(link) == node for link in (process / "fd").iterdir()):
                names.add((process / "comm").read_text().strip())
        except OSError:  # another user's, or gone
            continue
    return sorted(names)


def _numbered(folder: Path) -> Iterable[Path]:
    try:
        return [entry for entry in folder.iterdir() if entry.name.isdigit()]
    except OSError:
        return []
