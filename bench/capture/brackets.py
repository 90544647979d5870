"""Brackets of still cameras: each exposure set and triggered, and by the body itself where it has one.

    python -m bench.capture.brackets [--json] [--write]

In the virtual clock's time, with simulated bodies: as they are, whose shutter opens at once, and with 0.3 s
between an order and the exposure, as with bodies that shoot about two frames a second under remote control.
--write puts the table into bench/results/brackets.md.
"""

from dataclasses import replace
from typing import Any

from bench.support.record import arguments, deliver, machine, words
from drivers.ptp import find_cameras
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.exposure import Exposure

BRACKETS = {
    "3 x 2 stops": (1 / 250, 1 / 60, 1 / 15),
    "4 x 1 stop": (1 / 500, 1 / 250, 1 / 125, 1 / 60),
    "4 x 2 stops": (1 / 250, 1 / 60, 1 / 15, 1 / 4),
    "5 x 1 stop": (1 / 500, 1 / 250, 1 / 125, 1 / 60, 1 / 30),
    "9 x 1 stop": (1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 15, 1 / 30, 1 / 60, 1 / 125, 1 / 250),
}
LAGS = (0.0, 0.3)


def measure() -> dict[str, Any]:
    rows = []
    for lag in LAGS:
        for model in PROFILES.values():
            for name, times in BRACKETS.items():
                rows.append({"model": model.name, "lag": lag, "bracket": name, **_timed(model, lag, times)})
    return {"machine": machine(), "rows": rows}


def _timed(model: Any, lag: float, times: tuple[float, ...]) -> dict[str, Any]:
    """Virtual seconds one by one and by `bracket`, whose frames are all as asked."""
    clock = VirtualClock()
    bus = VirtualBus(clock)
    rig = simulate("toy", cameras=1)
    bus.plug(PtpDevice(Responder(rig.devices[0], replace(model, lag=lag), clock)))
    (camera,) = find_cameras(bus, clock)
    exposures = [Exposure(time=time, f_number=4.0, iso=100.0) for time in times]
    camera.identify()
    began = clock.now()
    for exposure in exposures:
        camera.set_exposure(exposure)
        camera.arm()
        camera.trigger()
        camera.collect()
    alone, began = clock.now() - began, clock.now()
    frames = camera.bracket(exposures)
    seconds = clock.now() - began
    told = [frame.metadata.exposure for frame in frames]
    as_asked = all(said == asked for said, asked in zip(told, exposures, strict=True))
    camera.close()
    return {"alone": alone, "bracket_seconds": seconds, "as_asked": as_asked}


def report(result: dict[str, Any]) -> str:
    rows = [
        f"| {row['model']} | {row['lag']:g} | {row['bracket']} | {row['alone']:.2f} | "
        f"{row['bracket_seconds']:.2f} | {row['bracket_seconds'] / row['alone']:.2f} | "
        f"{'yes' if row['as_asked'] else 'NO'} |"
        for row in result["rows"]
    ]
    return "\n".join(
        [
            "# Brackets by the body itself",
            "",
            "`python -m bench.capture.brackets --write`: a simulated body on the virtual bus, virtual "
            "seconds, each exposure set and triggered, and by `bracket`, the body itself where it can. "
            f"{words(result['machine'])}.",
            "",
            "| body | s from order to exposure | bracket | one by one | bracket | ratio | all as asked |",
            "|---|---|---|---|---|---|---|",
            *rows,
            "",
            "Sony's body shoots 10 frames a second and has brackets of 3, 5 and 9, Canon's 4.5 and 3 frames; "
            "what fits none, and the others, are shot one by one.",
            "",
        ]
    )


def main() -> None:
    options = arguments(__doc__).parse_args()
    result = measure()
    deliver(options, "brackets", result, report(result))


if __name__ == "__main__":
    main()
