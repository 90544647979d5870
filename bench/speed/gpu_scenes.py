"""Two scenes trained whole on a GPU and on the processor beside it: speed, quality, memory.

    python -m bench.speed.gpu_scenes [--quick] [--json] [--write] [--work FOLDER]

lego (of RIG_DATA, left out without it) and the demo with its true calibration, by preset, nothing set by
hand; each training is a process of its own. Memory is the most that torch held on the GPU, beside its
forecast (`recon.decide.cost.gpu_memory`). --quick: drafts.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import torch

from bench.peers.compare import session_of
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import session
from imaging.compute import memory
from recon.data.load import load
from recon.data.resident import pixels_of
from recon.decide.cost.gpu_memory import needed
from recon.decide.cost.memory_need import step_bytes
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.scene import open_scene
from recon.train.devices.training_device import training_device
from recon.train.devices.warm_up import warm_up

SCENES = ("lego", "demo")
PLACES = {"gpu": {}, "processor": {"CUDA_VISIBLE_DEVICES": ""}}
"""Environment variables of a training, by where it runs."""


def trained(name: str, quality: Any, work: Path) -> dict[str, Any]:
    """Row of a training in this process, where it may run."""
    warm_up(lambda message, done, total: None, training_device())
    folder = session_of(name, work) if name == "lego" else session(work, name, 0, "truth")
    said: list[str] = []
    began = time.monotonic()
    request = TrainingRequest(quality=quality, name="gpu-scenes", replace=True)
    scene = open_scene(reconstruct(folder, request, on_message=said.append))
    waited, record, metrics = time.monotonic() - began, scene.record, evaluate(scene.folder)
    views = load(folder, max_width=scene.views[0].lens.width).views
    pixels, step = max(map(pixels_of, views)), max(map(step_bytes, views))
    return {
        "device": record.device,
        "said": [line for line in said if "is not used" in line],
        "iterations": record.iterations,
        "gaussians": record.gaussians,
        "waited": waited,
        "rate": record.iterations / record.train_seconds,
        "db": metrics.hdr_psnr_mu_aligned if name == "demo" else metrics.ldr_psnr_oe,
        "peak": torch.cuda.max_memory_allocated() if torch.cuda.is_available() else 0,
        "forecast": needed(pixels, step, record.gaussians, record.degree),
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    rows = []
    for name in SCENES:
        if name == "lego" and not (Path(os.environ.get("RIG_DATA", "/none")) / name).is_dir():
            continue
        for place, setting in PLACES.items():
            words = [
                sys.executable,
                "-m",
                "bench.speed.gpu_scenes",
                "--one",
                name,
                "--work",
                str(options.work),
            ]
            words += ["--quick"] if options.quick else []
            done = subprocess.run(
                words, env=os.environ | setting, stdout=subprocess.PIPE, text=True, check=False
            )
            row = {"scene": name, "place": place, "failed": done.returncode != 0}
            rows.append(row | (json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else {}))
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Scenes trained on a GPU and on the processor",
        "",
        f"`python -m bench.speed.gpu_scenes --write`; {words(result['machine'])}. dB of held-out views: "
        "of the demo's light after the mu-law, of lego over black. Memory of the GPU, and its forecast.",
        "",
        "| scene | device | iterations | Gaussians | s | iterations a second | dB | memory | forecast |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        if row["failed"]:
            lines.append(f"| {row['scene']} | {row['place']}: FAILED | | | | | | | |")
            continue
        cells = [row["scene"], row["device"] + "".join(f" ({line})" for line in row["said"])]
        cells += [
            f"{row['iterations']:,}",
            f"{row['gaussians']:,}",
            f"{row['waited']:.0f}",
            f"{row['rate']:.1f}",
        ]
        cells += [
            f"{row['db']:.2f}",
            *(memory.text(row[key]) if row["peak"] else "" for key in ("peak", "forecast")),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--one", choices=SCENES, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(trained(options.one, "draft" if options.quick else "standard", options.work)))
        return
    if training_device().type == "cpu":
        sys.exit(
            "bench/speed/gpu_scenes.py: torch and Triton see no GPU here, so there is nothing to measure."
        )
    result = measure(options)
    deliver(options, "gpu_scenes", result, report(result))


if __name__ == "__main__":
    main()
