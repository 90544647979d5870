"""Forecasts of shoots against the clock: simulated cameras, in the virtual clock's time.

    python -m bench.capture.forecast [--quick] [--json] [--write]

A dry run forecasts seconds and bytes by the test shots of the meter; the same is then shot. One camera and
three of each make, PTP and USB3 Vision, with short and long exposures; and three on one slow bus.
--write puts the table into bench/results/forecast.md.
"""

import tempfile
from pathlib import Path
from typing import Any

from bench.support.record import arguments, deliver, machine, words
from capture.connected_rig import connected_source
from capture.record.shooting import rehearse, shoot
from capture.request import RigRequest
from capture.rigfile.rigfile import RigFile, read_rig_file
from drivers.sim.bus_rig import VISION, BusRig
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.rigs import simulate

MODELS = (*PROFILES, VISION)
HEAD = 'frames = 2\npause = 0\n[bracket]\nexposures = {stops}\ntime = "{time}"\nf_number = 8\n'
CAMERA = '[[camera]]\nname = "cam{n}"\nserial = "SIM-RAW-{serial:03d}"\n'
BRACKETS = {"short": ("[-4, 0, 4]", "1/60"), "long": ("[-2, 0, 2]", "2")}
SLOW = 20_000.0
"""Bytes a second of a bus on which a picture of the toy rig takes 0.4 s, as a RAW file does on USB 2."""


def case(folder: Path, model: str, cameras: int, bracket: str, bandwidth: float | None) -> dict[str, Any]:
    """One shoot: forecast and outcome."""
    stops, time = BRACKETS[bracket]
    rows = [HEAD.format(stops=stops, time=time)]
    rows += [CAMERA.format(n=n, serial=n + 1) for n in range(cameras)]
    (folder / "RIG.toml").write_text("".join(rows))
    rig, out = read_rig_file(folder / "RIG.toml"), folder / f"{model}-{cameras}-{bracket}-{bandwidth}"
    request = request_of(rig, model, cameras, bandwidth)
    with connected_source(rig, request) as source:
        forecast = rehearse(source, out, request).forecast
    request = request_of(rig, model, cameras, bandwidth)
    with connected_source(rig, request) as source:
        run = shoot(source, out, request).run
    assert run is not None
    assert forecast.size is not None
    return {
        "model": model,
        "cameras": cameras,
        "bracket": bracket,
        "slow": bandwidth is not None,
        "forecast": forecast.seconds,
        "on_one_bus": forecast.on_one_bus,
        "clock": run.seconds,
        "bytes": forecast.size / run.bytes,
    }


def request_of(rig: RigFile, model: str, cameras: int, bandwidth: float | None) -> RigRequest:
    """A rig on a bus of its own."""
    sim = simulate("toy", 0, cameras=cameras, samples=1)
    bus = BusRig(sim, model=model, bandwidth=bandwidth)
    return RigRequest(operator=sim, positions=sim.frames, backend=bus.backend, clock=bus.clock)


def measure(quick: bool) -> dict[str, Any]:
    rows = []
    with tempfile.TemporaryDirectory() as place:
        for model in MODELS[:1] if quick else MODELS:
            for cameras in (1, 3):
                rows += [case(Path(place), model, cameras, bracket, None) for bracket in BRACKETS]
            rows.append(case(Path(place), model, 3, "short", SLOW))
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    rows = result["rows"]
    apart = [row["forecast"] / row["clock"] for row in rows if not row["slow"]]
    slow = [(row["forecast"] / row["clock"], row["on_one_bus"] / row["clock"]) for row in rows if row["slow"]]
    sizes = [row["bytes"] for row in rows]
    return "\n".join(
        [
            "# Forecasts of shoots",
            "",
            "`python -m bench.capture.forecast --write`: forecast by test shots against the virtual clock, 2 "
            f"frames of 3 exposures. {words(result['machine'])}.",
            "",
            "| cameras | exposures | bus | forecast, s | on one bus, s | clock, s | forecast / clock | "
            "bytes, forecast / files |",
            "|---|---|---|---|---|---|---|---|",
            *(
                f"| {row['cameras']} {row['model']} | {row['bracket']} | "
                f"{'slow' if row['slow'] else 'fast'} | {row['forecast']:.2f} | "
                f"{row['on_one_bus']:.2f} | {row['clock']:.2f} | "
                f"{row['forecast'] / row['clock']:.3f} | {row['bytes']:.3f} |"
                for row in rows
            ),
            "",
            f"Where pictures travel side by side the forecast is {min(apart):.2f} to {max(apart):.2f} of the "
            f"clock. On one slow bus the clock is between the forecast ({min(one for one, _ in slow):.2f} to "
            f"{max(one for one, _ in slow):.2f} of it) and that of one bus "
            f"({min(one for _, one in slow):.2f} to {max(one for _, one in slow):.2f}). Bytes are "
            f"{min(sizes):.3f} to {max(sizes):.3f} of the files.",
            "",
        ]
    )


def main() -> None:
    options = arguments(__doc__).parse_args()
    result = measure(options.quick)
    deliver(options, "forecast", result, report(result))


if __name__ == "__main__":
    main()
