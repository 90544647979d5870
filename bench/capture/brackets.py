"""Brackets of still cameras: each exposure set and triggered, and by the body itself where it has one.

    python -m bench.capture.brackets [--json] [--write]

In the virtual clock's time, with simulated bodies: as they are, whose shutter opens at once, and with 0.3 s
between an order and the exposure, as with bodies that shoot about two frames a second under remote control.
--write puts the table into bench/results/brackets.md.
"""

from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from bench.support.record import arguments, deliver, machine, words
from capture.record.recorder import record
from drivers.camera import Camera
from drivers.errors import CameraRefused
from drivers.ptp import PtpCamera, find_cameras
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.ptp.responder import Responder
from drivers.sim.ptp.usb_device import PtpDevice
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.optics.exposure import Exposure
from imaging.session.records import PlanRecord, SessionRecord
from imaging.session.session import Session

BRACKETS = {
    "3 x 2 stops": (1 / 250, 1 / 60, 1 / 15),
    "4 x 1 stop": (1 / 500, 1 / 250, 1 / 125, 1 / 60),
    "4 x 2 stops": (1 / 250, 1 / 60, 1 / 15, 1 / 4),
    "5 x 1 stop": (1 / 500, 1 / 250, 1 / 125, 1 / 60, 1 / 30),
    "9 x 1 stop": (1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 15, 1 / 30, 1 / 60, 1 / 125, 1 / 250),
}
LAGS = (0.0, 0.3)
FRAMES = 3
_WHEN = datetime(2026, 1, 1)


def measure() -> dict[str, Any]:
    rows = []
    for lag in LAGS:
        for model in PROFILES.values():
            for name, times in BRACKETS.items():
                rows.append(
                    {
                        "model": model.name,
                        "lag": lag,
                        "bracket": name,
                        "count": len(times),
                        **_timed(model, lag, times),
                        **_captured(model, lag, times),
                    }
                )
    return {"machine": machine(), "rows": rows}


def _timed(model: Any, lag: float, times: tuple[float, ...]) -> dict[str, Any]:
    """Virtual seconds one by one and by `bracket`, None without one; how many of them that brings."""
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
    seconds: float | None = None
    with suppress(CameraRefused):
        stated = [frame.metadata.exposure for frame in camera.bracket(exposures)]
        seconds = clock.now() - began
    brought = 0 if seconds is None else sum(exposure in stated for exposure in exposures)
    camera.close()
    return {"alone": alone, "bracket_seconds": seconds, "brought": brought}


def _captured(model: Any, lag: float, times: tuple[float, ...]) -> dict[str, Any]:
    """Virtual seconds of the recorder for FRAMES frames, one by one and as it does it; all are as asked."""
    seconds, as_asked = [], True
    for in_camera in (False, True):
        clock = VirtualClock()
        bus = VirtualBus(clock)
        rig = simulate("toy", cameras=1, positions=FRAMES)
        bus.plug(PtpDevice(Responder(rig.devices[0], replace(model, lag=lag), clock)))
        (camera,) = find_cameras(bus, clock)
        (record_of,) = rig.records()
        plan = PlanRecord(
            plan="scene",
            kind="scene",
            created=_WHEN,
            bracket=tuple(Exposure(time=time, f_number=4.0, iso=100.0) for time in times),
            frames=tuple(range(FRAMES)),
            cameras=(record_of.name,),
            reason="bench",
        )
        driver: Camera = camera if in_camera else _OneByOne(camera)
        with TemporaryDirectory() as folder:
            identity = SessionRecord(name="bench", created=_WHEN, origin="bench", cameras=(record_of,))
            session = Session.create(Path(folder) / "S", identity)
            session.append_plan(plan)
            began = clock.now()
            result = record(session, plan, {record_of.name: driver}, clock=clock, move_to=rig.move_to)
            seconds.append(clock.now() - began)
            as_asked &= not result.missing and not result.problems
            as_asked &= all(shot.reported == shot.requested for shot in session.shots())
        camera.close()
    return {"capture_alone": seconds[0], "capture": seconds[1], "as_asked": as_asked}


class _OneByOne:
    """A camera without brackets of its own."""

    def __init__(self, camera: PtpCamera) -> None:
        self._camera = camera
        self.verified, self.identify = camera.verified, camera.identify
        self.capabilities, self.set_exposure = camera.capabilities, camera.set_exposure
        self.arm, self.trigger, self.collect = camera.arm, camera.trigger, camera.collect
        self.close = camera.close
        self.keeps, self.keep, self.fetch = camera.keeps, camera.keep, camera.fetch

    @property
    def where(self) -> str:
        """Last known place."""
        return self._camera.where


def report(result: dict[str, Any]) -> str:
    rows = [
        f"| {row['model']} | {row['lag']:g} | {row['bracket']} | {row['alone']:.2f} | {_share(row)} | "
        f"{row['capture_alone']:.2f} | {row['capture']:.2f} | {row['capture'] / row['capture_alone']:.2f} | "
        f"{'yes' if row['as_asked'] else 'NO'} |"
        for row in result["rows"]
    ]
    return "\n".join(
        [
            "# Brackets by the body itself",
            "",
            "`python -m bench.capture.brackets --write`: a simulated body on the virtual bus, virtual "
            "seconds. First one bracket by the driver: each exposure set and triggered, and the body's own, "
            "with how many of the exposures that brings. Then the recorder of `rig capture`, with "
            f"{FRAMES} frames of the bracket back to back: one by one, and as it does it, the body's own "
            f"brackets and one by one what these leave out. {words(result['machine'])}.",
            "",
            "| body | s from order to exposure | bracket | one by one | the body's own | ratio | "
            f"{FRAMES} frames one by one | as captured | ratio | all as asked |",
            "|---|---|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            "Sony's body shoots 10 frames a second and has brackets of 3, 5 and 9, Nikon's 5.5 and 3, 5, 7 "
            "and 9, Canon's 4.5 and 3: Sony and Nikon shoot five for four. Where an order takes no time, "
            "bursts of Canon and Nikon are slower than single frames, of which simulated bodies write 6 a "
            "second.",
            "",
        ]
    )


def _share(row: dict[str, Any]) -> str:
    if row["bracket_seconds"] is None:
        return "none | "
    number = "" if row["brought"] == row["count"] else f" ({row['brought']} of {row['count']})"
    ratio = f"{row['bracket_seconds'] / row['alone']:.2f}" if not number else ""
    return f"{row['bracket_seconds']:.2f}{number} | {ratio}"


def main() -> None:
    options = arguments(__doc__).parse_args()
    result = measure()
    deliver(options, "brackets", result, report(result))


if __name__ == "__main__":
    main()
