"""White of a rig's cameras, equalised by the scene points that they share, against the simulator's truth.

    python -m bench.calibration.light.white_balance [--quick] [--json] [--write]

The demo's rig, the matrices of its files up to 6 % off white by camera and channel: how far channels are off
the rig's mean before and after calibration. One session in three frames; in two with --quick. --write
puts the table into bench/results/white_balance.md.
"""

import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from bench.support.record import arguments, deliver, machine, words
from calib.calibrate import calibrate
from calib.sensor import metadata
from capture.simulated import capture_simulated
from imaging.sensor.mosaic import as_matrix

SEED = 1
TINTS = {"cam0": (1.06, 1.0, 0.95), "cam1": (0.96, 1.0, 1.04), "cam3": (0.97, 1.0, 0.98)}


def balance(frames: int) -> dict[str, Any]:
    """Return how far off white a rig's cameras are from each other, before and after, in per cent."""
    described = metadata.describe

    def tinted(*what: Any) -> metadata.CameraSensor:
        body = described(*what)
        tint = np.array(TINTS.get(what[1].name, (1.0, 1.0, 1.0)))
        assert body.camera_from_rec709 is not None
        return replace(body, camera_from_rec709=as_matrix(tint[:, None] * np.array(body.camera_from_rec709)))

    with tempfile.TemporaryDirectory() as folder:
        session = Path(folder) / "session"
        capture_simulated("demo", session, seed=SEED, frames=frames)
        with patch("calib.sensor.metadata.describe", tinted):
            record = calibrate(session)
        truth = json.loads((session / "truth" / "truth.json").read_text())["cameras"]
    remaining = []
    for camera in record.cameras:
        matrix, true = np.array(camera.camera_from_rec709), np.array(truth[camera.name]["camera_from_rec709"])
        remaining.append(np.log((matrix / true).mean(axis=1)))
    before = np.log([TINTS.get(camera.name, (1.0, 1.0, 1.0)) for camera in record.cameras])
    after = np.array(remaining)
    rung = next(rung for rung in record.rungs if rung.name == "white_balance")
    return {
        "cameras": len(remaining),
        "before": 100 * float(np.abs(before - before.mean(axis=0)).max()),
        "after": 100 * float(np.abs(after - after.mean(axis=0)).max()),
        "stated": 100 * float(np.max([camera.white_balance_error for camera in record.cameras])),
        "gain": rung.gain,
        "gain_error": rung.standard_error,
        "taken": rung.taken,
    }


def table(result: dict[str, Any]) -> str:
    balance = result["balance"]
    return "\n".join(
        [
            "# White balance of a rig",
            "",
            "`python -m bench.calibration.light.white_balance --write`: the demo's rig with tinted matrices, "
            f"{result['frames']} frames, seed {SEED}. {words(result['machine'])}.",
            "",
            "| Cameras | Off before, % | Off after, % | Stated standard error, % | Taken | Held-out gain |",
            "| ---: | ---: | ---: | ---: | --- | ---: |",
            f"| {balance['cameras']} | {balance['before']:.2f} | {balance['after']:.2f} "
            f"| {balance['stated']:.2f} | {'yes' if balance['taken'] else 'no'} "
            f"| {balance['gain']:.4f} ± {balance['gain_error']:.4f} |",
            "",
        ]
    )


def main(argv: Sequence[str] | None = None) -> None:
    options = arguments(__doc__).parse_args(argv)
    frames = 2 if options.quick else 3
    result = {"machine": machine(), "seed": SEED, "frames": frames, "balance": balance(frames)}
    deliver(options, "white_balance", result, table(result))


if __name__ == "__main__":
    main()
