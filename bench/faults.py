"""A rig on a bad day: cameras on the virtual bus, a twentieth of all operations faulted.

    python bench/faults.py [--quick] [--json] [--write] [--seed 0] [--model generic]

The same capture is run without faults and with them, in the virtual clock's time. With them it has to be
complete, every file to hold its hash and the exposure that was asked for. --write puts the table into
bench/results/faults.md.
"""

import tempfile
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from record import arguments, deliver, machine, words

from capture.beginning import begin
from capture.check import check
from capture.recorder import record
from drivers.sim.faults import ROUGH, Mix
from drivers.sim.on_bus import BusRig
from drivers.sim.rigs import simulate
from imaging.exposure import Exposure
from imaging.records import PlanRecord, SessionRecord

TIMES = (1 / 1000, 1 / 250, 1 / 60, 1 / 15, 1 / 4, 1.0, 4.0)


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
        reason="bench/faults.py",
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
        "operations": bus.plan.operations(),
        "faults": dict(Counter(one.fault.kind.value for one in bus.plan.log)),
    }


def measure(cameras: int, frames: int, seed: int, model: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as place:
        calm = capture(Path(place) / "calm", cameras, frames, seed, model, None)
        rough = capture(Path(place) / "rough", cameras, frames, seed, model, ROUGH)
    return {
        "machine": machine(),
        "cameras": cameras,
        "frames": frames,
        "model": model,
        "seed": seed,
        "calm": calm,
        "rough": rough,
        "ratio": rough["seconds"] / calm["seconds"],
    }


def report(result: dict[str, Any]) -> str:
    rough, calm = result["rough"], result["calm"]
    rows = [
        ("virtual seconds", f"{calm['seconds']:.1f}", f"{rough['seconds']:.1f}"),
        *(
            (name.replace("_", " "), *(_count(run[name]) for run in (calm, rough)))
            for name in ("operations", "planned", "taken", "sound", "missing", "wrong_exposure", "retried")
        ),
    ]
    return "\n".join(
        [
            "# A rig on a bad day",
            "",
            f"`python bench/faults.py --write`: {result['cameras']} cameras ({result['model']}) x "
            f"{len(TIMES)} exposures x {result['frames']} frames on the virtual bus, seed {result['seed']}. "
            f"{words(result['machine'])}.",
            "",
            "| | without faults | a twentieth of operations faulted |",
            "|---|---|---|",
            *(f"| {name} | {one} | {other} |" for name, one, other in rows),
            "",
            f"{result['ratio']:.2f} times the virtual time. What happened: "
            + ", ".join(f"{count} x {name}" for name, count in sorted(rough["faults"].items()))
            + ".",
            "",
        ]
    )


def _count(value: Any) -> str:
    return str(len(value) if isinstance(value, list) else value)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--model", default="generic")
    options = parser.parse_args()
    size = (2, 2) if options.quick else (8, 10)
    result = measure(*size, options.seed, options.model)
    deliver(options, "faults", result, report(result))


if __name__ == "__main__":
    main()
