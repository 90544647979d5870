"""Cameras found, opened, asked and closed a thousand times: nothing may pile up.

    python -m bench.capture.soak [--quick] [--json] [--write]

On the virtual bus, two still cameras and a machine vision camera, with the drivers that drive hardware;
and real libusb enumerated as often. --write puts the table into bench/results/soak.md.
"""

import gc
import os
import sys
from typing import Any

from bench.support.record import arguments, deliver, machine, words
from drivers.discovery import ask_all, find_cameras
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.u3v.device import U3vDevice
from drivers.usb import default_backend


def descriptors() -> int:
    """Open file descriptors of this process."""
    return len(os.listdir("/proc/self/fd"))


def resident_kb() -> int:
    """Memory of this process."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


def soak(cycles: int) -> dict[str, Any]:
    """Return what a thousand cycles add, after ten that fill what is filled once."""
    bus = BusRig(simulate("toy"))
    other = simulate("toy", seed=1, cameras=3)
    bus.backend.plug(U3vDevice(other.devices[2], bus.clock))
    libusb = default_backend()

    def cycle() -> None:
        listed = list(ask_all(bus.backend, bus.clock))
        if len(listed) != 3 or any(one.error for one in listed):
            sys.exit(f"bench/capture/soak.py: cameras did not answer: {listed}")
        if libusb is not None:
            find_cameras(libusb, bus.clock)

    for _ in range(10):
        cycle()
    gc.collect()
    files, resident, objects = descriptors(), resident_kb(), len(gc.get_objects())
    quarters = []
    for number in range(1, cycles + 1):
        cycle()
        if number % (cycles // 4) == 0:
            gc.collect()
            quarters.append(resident_kb() - resident)
    return {
        "cycles": cycles,
        "cameras": 3,
        "libusb": libusb is not None,
        "descriptors_added": descriptors() - files,
        "objects_added": len(gc.get_objects()) - objects,
        "resident_kb_added_by_quarter": quarters,
        "handles_open": bus.backend.open_handles,
    }


def report(result: dict[str, Any]) -> str:
    run = result["soak"]
    return "\n".join(
        [
            "# A thousand times opened and closed",
            "",
            f"`python -m bench.capture.soak --write`: {run['cycles']} cycles of finding, opening, "
            "asking and closing "
            f"{run['cameras']} cameras on the virtual bus, real libusb "
            f"{'enumerated as often' if run['libusb'] else 'not there'}. {words(result['machine'])}.",
            "",
            "| added | |",
            "|---|---|",
            f"| file descriptors | {run['descriptors_added']} |",
            f"| Python objects | {run['objects_added']} |",
            f"| resident memory after each quarter, kB | "
            f"{', '.join(str(kb) for kb in run['resident_kb_added_by_quarter'])} |",
            f"| handles left open | {run['handles_open']} |",
            "",
        ]
    )


def main() -> None:
    parser = arguments(__doc__)
    options = parser.parse_args()
    result = {"machine": machine(), "soak": soak(100 if options.quick else 1000)}
    deliver(options, "soak", result, report(result))


if __name__ == "__main__":
    main()
