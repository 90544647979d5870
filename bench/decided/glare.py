"""Veiling glare: its estimate from dark scene points, and the gain by knowing it.

    python -m bench.decided.glare [--quick] [--json] [--write] [--seeds 1] [--work FOLDER]

Simulated rigs whose lenses scatter a share of the light by a kernel of their own, half of it a bloom, half
over the whole picture (`drivers.sim.camera.stray_light`), calibrated from the truth and trained by the preset
draft with glare left to be and as decided. Light of held-out views is compared with the truth. Finished rows
are kept in FOLDER.
"""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal
from unittest import mock

import numpy as np

from bench.support.oracle import oracle_session
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from drivers.sim import rigs
from recon.data.truth import true_radiance
from recon.decide.overrides import Overrides
from recon.evaluate import measured
from recon.reconstruct import reconstruct
from recon.result.scene import open_model

SHARES = (0.0, 0.003, 0.01, 0.03)
DARKEST = 0.2
"""Share of the pixels that count as dark."""


def session(rig: str, share: float, seed: int, work: Path) -> Path:
    """The rig's session with glare, calibrated from the truth."""
    name = f"{rig}-glare-{share:g}"
    with mock.patch.dict(rigs._RIGS, {name: replace(rigs._RIGS[rig], glare=share)}):
        return oracle_session(work / f"{name}-{seed}", name, seed=seed)


def trained(rig: str, share: float, seed: int, refine: Literal["none"] | None, work: Path) -> dict[str, Any]:
    """Figures of one training; refine: None as decided."""
    made = reconstruct(
        session(rig, share, seed, work), method="nh-3dgs", quality="draft", seed=seed, name="scene",
        replace=True, overrides=Overrides(refine=refine),
    )  # fmt: skip
    opened = open_model(made)
    light, _, rows, pooled = measured(opened)
    true = [true_radiance(opened.dataset.session, view).mean(-1) for view in opened.dataset.reported]
    ours = np.stack(light).mean(-1) * pooled["alignment_scale"]
    stops = np.log2(np.maximum(ours, 1e-9) / np.stack(true))
    dark = stops[np.stack(true) < np.quantile(true, DARKEST)]
    shares = [view.sensor.glare for view in opened.dataset.train]
    rung = next(rung for rung in opened.record.rungs if rung.name == "refine glare")
    return {
        "taken": rung.taken, "reason": rung.reason, "share": float(np.mean(shares)),
        "dark": float(np.median(np.abs(dark))), "bias": float(np.median(dark)),
        **{key: float(np.mean([row[key] for row in rows])) for key in ("raw_psnr", "hdr_psnr_mu_aligned")},
    }  # fmt: skip


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, rows = Cache(options.work / "glare.jsonl"), []
    scenes, shares = (("toy",), (0.0, 0.03)) if options.quick else (("demo", "gallery"), SHARES)
    for rig in scenes:
        for share in shares:
            for seed in range(options.seeds):
                pair = [
                    cache.get(
                        f"{rig} {share} {seed} {refine}",
                        partial(trained, rig, share, seed, refine, options.work),
                    )
                    for refine in ("none", None)
                ]
                rows.append({"rig": rig, "true": share, "left": pair[0], "decided": pair[1]})
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Veiling glare",
        "",
        f"`python -m bench.decided.glare --write`: simulated lenses that scatter a share of the light, true "
        f"calibration, quality draft. {words(result['machine'])}.",
        "",
        "Light of held-out views: error of the darkest fifth, median stops, and dB (mu-law, aligned); glare",
        "left to be, and as decided.",
        "",
        "| scene | scattered, % | taken | found, % | dark, left | dark, decided | dB, left | dB, decided |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        left, decided = row["left"], row["decided"]
        lines.append(
            f"| {row['rig']} | {100 * row['true']:g} | {'yes' if decided['taken'] else 'no'} "
            f"| {100 * decided['share']:.2f} | {left['dark']:.3f} | {decided['dark']:.3f} "
            f"| {left['hdr_psnr_mu_aligned']:.2f} | {decided['hdr_psnr_mu_aligned']:.2f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__, seeds=1).parse_args()
    result = measure(options)
    deliver(options, "glare", result, report(result))


if __name__ == "__main__":
    main()
