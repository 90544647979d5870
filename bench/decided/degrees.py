"""Harmonics of an own degree for each Gaussian, against one degree for all of a scene.

    python -m bench.decided.degrees [--quick] [--json] [--write] [--work FOLDER] [--ladder FOLDER]

Scenes with gloss, each trained once with harmonics of degree 2 for all. Then those Gaussians lose their
harmonics whose colour they change least in the training views (the change, as a share of the colour, times
the weight with which it is blended, over all views), a growing share of all, and held-out views are measured
again. Nothing is trained afterwards, so that a loss is at most what is stated. bytes: of a Gaussian, if a
file could leave out what is zero; neither PLY nor USD can.
"""

import argparse
import shutil
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.autograd import backward

from bench.recon import ladder_scenes
from bench.recon.presets import SCENES, TOYS, folder_of
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from recon.decide.overrides import Overrides
from recon.decide.size import PLAIN
from recon.evaluate import measured
from recon.reconstruct import reconstruct
from recon.result.scene import Opened, open_model
from recon.splat import rasterize
from recon.train.warm_up import warm_up

SHARES = (0.0, 0.25, 0.5, 0.75, 0.9, 1.0)
GLOSSY = "view-dependent"
HARMONICS = 24
"""Numbers of a Gaussian's harmonics of degrees 1 and 2."""


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "degrees.jsonl")
    jobs = {scene.name: (folder_of, scene, options.work) for scene in options.scenes}
    jobs |= {one.name: (ladder_scenes.session, one, options.ladder) for one in options.kinds}
    rows = []
    for name, job in jobs.items():
        rows.append({"scene": name} | cache.get(name, partial(one_scene, job, options)))
    return {"machine": machine(), "rows": rows}


def one_scene(job: tuple[Any, ...], options: argparse.Namespace) -> dict[str, Any]:
    """Held-out dB, and dB to the truth, by the share of Gaussians without harmonics."""
    session, *scene = job
    folder: Path = session(*scene)
    warm_up(lambda message, done, total: None)
    overrides = Overrides(degree=2, gaussians=options.gaussians, iterations=options.iterations, refine="none")
    made = reconstruct(folder, overrides=overrides, name="degrees")
    opened = open_model(made)
    parameters = opened.scene.gaussians.parameters
    (key,) = [name for name in parameters if name.endswith("_rest")]
    rest, order = parameters[key].detach().clone(), effects(opened, key).argsort()
    steps = []
    for share in SHARES:
        left = rest.clone()
        left[order[: round(share * len(order))]] = 0
        parameters[key] = left
        _, _, figures, _ = measured(opened)
        own = [row["raw_psnr" if "raw_psnr" in row else "ldr_psnr_oe"] for row in figures]
        true = [row["hdr_psnr_mu_aligned"] for row in figures]
        steps.append({"share": share, "db": float(np.mean(own)), "truth_db": float(np.mean(true))})
    parameters[key] = rest
    frames = {degree: seconds(opened, degree) for degree in (0, 2)}
    shutil.rmtree(made)
    return {"gaussians": len(order), "steps": steps, "slower": frames[2] / frames[0]}


def effects(opened: Opened, key: str) -> torch.Tensor:
    """Change of the training views by each Gaussian's harmonics, [N], in units that only compare."""
    training = opened.training
    gaussians, renderer = training.gaussians, training.renderer()
    parameters = {name: value.detach() for name, value in gaussians.parameters.items()}
    plain = parameters | {key: torch.zeros_like(parameters[key])}
    found = torch.zeros(len(gaussians))
    for view in opened.dataset.train:
        motion = view.lens.cam_from_world
        centre = torch.from_numpy((-motion[:3, :3].T @ motion[:3, 3]).astype(np.float32))
        directions = torch.nn.functional.normalize(parameters["means"] - centre, dim=1)
        colours = renderer.appearance.colours(parameters, directions, 2).requires_grad_(True)
        without = renderer.appearance.colours(plain, directions, 2)
        image = rasterize(
            parameters["means"], parameters["quats"], gaussians.scales().detach(),
            gaussians.opacities().detach(), colours, view.lens, limits=renderer.limits,
        ).image  # fmt: skip
        backward(image.sum())
        assert colours.grad is not None
        weight = colours.grad.mean(1)
        change = (colours.detach() - without).abs().sum(1) / (colours.detach() + without).sum(1).clamp_min(
            1e-12
        )
        found += weight * change
    return found


def seconds(opened: Opened, degree: int) -> float:
    """Median time of a held-out view, with all Gaussians of a degree."""
    took = []
    with torch.no_grad():
        for _ in range(3):
            for view in opened.dataset.held_out:
                began = time.perf_counter()
                opened.training.renderer()(opened.training.gaussians, view.lens, degree=degree)
                took.append(time.perf_counter() - began)
    return float(np.median(took))


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Harmonics for some Gaussians only",
        "",
        f"`python -m bench.decided.degrees --write`, {words(result['machine'])}. Trained with degree "
        "2 for all, then "
        "without the harmonics of a share of the Gaussians, those first in which they change least; held-out "
        "pictures / light, dB less than with all. slower: a render with degree 2 for all to one without.",
        "",
        f"| scene | Gaussians | {' | '.join(f'{share:.0%}' for share in SHARES[1:])} | slower |",
        "|---|---|" + "---|" * len(SHARES),
    ]
    for row in result["rows"]:
        whole, *less = row["steps"]
        cells = [
            f"{step['db'] - whole['db']:+.2f} / {step['truth_db'] - whole['truth_db']:+.2f}" for step in less
        ]
        lines.append(f"| {row['scene']} | {row['gaussians']:,} | {' | '.join(cells)} | {row['slower']:.2f} |")
    sizes = ", ".join(f"{4 * (PLAIN + HARMONICS * (1 - share)):.0f}" for share in SHARES)
    lines += ["", f"bytes of a Gaussian, from none to all without: {sizes}."]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument(
        "--ladder", type=Path, default=WORK, help="where the sessions of bench/recon/ladder.py are"
    )
    options = parser.parse_args()
    options.iterations, options.gaussians = None, 15_000
    options.scenes = SCENES[:3]
    options.kinds = [one for one in ladder_scenes.scenes() if one.kind.name == GLOSSY]
    if options.quick:
        options.scenes, options.kinds, options.iterations, options.gaussians = TOYS[:1], [], 60, 600
    result = measure(options)
    deliver(options, "degrees", result, report(result))


if __name__ == "__main__":
    main()
