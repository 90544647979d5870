"""A rig on a bad day: cameras on the virtual bus, a twentieth of all operations faulted.

    python -m bench.capture.faults [--quick] [--json] [--write] [--seed 0] [--models generic,nikon-z6,...]

The same capture is run without faults and with them, in the virtual clock's time, once with each kind of
camera: PTP as its standard has it, what makers made of it, and USB3 Vision. With faults it has to be
complete, every file to hold its hash and the exposure that was asked for. --write puts the table into
bench/results/faults.md.
"""

import tempfile
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench.support.record import arguments, deliver, machine, words
from capture.check.check import check
from capture.record.new_session import begin
from capture.record.recorder import record
from drivers.sim.bus_rig import VISION, BusRig
from drivers.sim.faults import ROUGH, Mix
from drivers.sim.ptp.profiles import PROFILES
from drivers.sim.rigs import simulate
from imaging.optics.exposure import Exposure
from imaging.session.records import PlanRecord, SessionRecord, ShotRecord

TIMES = (1 / 1000, 1 / 250, 1 / 60, 1 / 15, 1 / 4, 1.0, 4.0)
MODELS = (*PROFILES, VISION)
WANTED = 1.3
"""Times the virtual time, which a rig on a bad day is to take at most."""


def capture(out: Path, cameras: int, frames: int, seed: int, model: str, mix: Mix | None) -> dict[str, Any]:
    """One capture: its virtual seconds, what is missing or wrong, and the faults that happened."""
    rig = simulate("toy", seed, cameras=cameras, positions=frames, samples=1)
    bus = BusRig(rig, mix=mix, model=model)
    devices = dict(zip((one.name for one in rig.records()), bus.cameras(), strict=True))
    session = begin(
        out,
        SessionRecord(
            name=out.name, created=datetime.now(UTC), origin="sim:toy", seed=seed, cameras=rig.records()
        ),
    )
    plan = PlanRecord(
        plan="scene",
        kind="scene",
        created=datetime.now(UTC),
        bracket=tuple(Exposure(time=time, f_number=4.0, iso=100.0) for time in TIMES),
        frames=tuple(range(frames)),
        cameras=tuple(devices),
        reason="bench/capture/faults.py",
    )
    session.append_plan(plan)
    began = bus.clock.now()
    result = record(session, plan, devices, clock=bus.clock, move_to=rig.move_to)
    seconds = bus.clock.now() - began
    proof = check(out)
    for camera in devices.values():
        camera.close()
    return {
        "seconds": seconds,
        "planned": result.planned,
        "taken": result.taken,
        "sound": proof.sound,
        "missing": list(result.missing),
        "wrong_exposure": list(result.problems),
        "retried": sum(shot.retries > 0 for shot in session.shots()),
        "again": _exposed_again(session.shots()),
        "operations": bus.plan.operations(),
        "faults": dict(Counter(one.fault.kind.value for one in bus.plan.log)),
    }


def _exposed_again(shots: Sequence[ShotRecord]) -> float:
    """Seconds that a rig whose cameras wait for one another at each step exposes again, at least."""
    longest: dict[tuple[int, int], float] = {}
    for shot in shots:
        step = shot.frame, shot.step
        longest[step] = max(longest.get(step, 0.0), shot.retries * TIMES[shot.step])
    return sum(longest.values())


def measure(cameras: int, frames: int, seed: int, models: Sequence[str]) -> dict[str, Any]:
    runs: dict[str, dict[str, Any]] = {}
    for model in models:
        with tempfile.TemporaryDirectory() as place:
            calm = capture(Path(place) / "calm", cameras, frames, seed, model, None)
            rough = capture(Path(place) / "rough", cameras, frames, seed, model, ROUGH)
        runs[model] = {"calm": calm, "rough": rough, "ratio": rough["seconds"] / calm["seconds"]}
    return {"machine": machine(), "cameras": cameras, "frames": frames, "seed": seed, "models": runs}


def report(result: dict[str, Any]) -> str:
    some = tuple(result["models"])
    chosen = "" if some == MODELS else f" --models {','.join(some)}"
    rows = []
    for model, runs in result["models"].items():
        calm, rough = runs["calm"], runs["rough"]
        happened = ", ".join(f"{count} x {name}" for name, count in sorted(rough["faults"].items()))
        numbers = (
            len(rough["missing"]),
            len(rough["wrong_exposure"]),
            rough["retried"],
            f"{rough['again']:.1f}",
        )
        rows.append(
            f"| {model} | {calm['seconds']:.1f} | {rough['seconds']:.1f} | {runs['ratio']:.2f} | "
            f"{rough['sound']} of {rough['planned']} | {' | '.join(map(str, numbers))} | "
            f"{rough['operations']} | {happened} |"
        )
    return "\n".join(
        [
            "# A rig on a bad day",
            "",
            f"`python -m bench.capture.faults --write{chosen}`: {result['cameras']} cameras x "
            f"{len(TIMES)} exposures "
            f"x {result['frames']} frames on the virtual bus, seed {result['seed']}, without faults and with "
            f"a twentieth of all operations faulted. {words(result['machine'])}.",
            "",
            "| cameras | virtual s without faults | with | ratio | sound | missing | wrong exposure "
            "| retried | exposing again, s | operations | what happened |",
            "|---|---|---|---|---|---|---|---|---|---|---|",
            *rows,
            "",
            f"Asked: all shots, in at most {WANTED:g} times the virtual time. {_missed(result)}",
            "",
        ]
    )


def _missed(result: dict[str, Any]) -> str:
    slow = [
        f"{model} ({runs['ratio']:.2f})" for model, runs in result["models"].items() if runs["ratio"] > WANTED
    ]
    return f"Slower: {', '.join(slow)}." if slow else "All are within."


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--models", default=",".join(MODELS))
    options = parser.parse_args()
    size = (2, 2) if options.quick else (8, 10)
    result = measure(*size, options.seed, options.models.split(","))
    deliver(options, "faults", result, report(result))


if __name__ == "__main__":
    main()
