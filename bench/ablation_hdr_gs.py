"""Where HDR-GS's curve starts from, and what holds it: one choice changed at a time, on HDR-NeRF's protocol.

    python bench/ablation_hdr_gs.py [--quick] [--json] [--write] [--seeds 2] [--pixels 100]
                                    [--iterations 1000] [--work FOLDER]

Scenes as in bench/hdr_nerf_protocol.py. Exp-3: all three exposures of a view; Exp-1: one each. `measured`: by
`rig calibrate --only response` from the photographs of the training. C0 is the term of the paper that pins
the curve's value at unit exposure to the truth's, with its weight of 0.5. Finished rows are kept in FOLDER.
"""

import argparse
import shutil
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from hdr_nerf_protocol import one_exposure_each, photographs
from hdr_nerf_scene import Size, write_scene
from record import WORK, arguments, deliver, machine, words
from torch import Tensor
from trial import Cache

from calib.calibrate import calibrate
from imaging import store
from imaging.calibration import Response, read_calibration
from recon.evaluate import evaluate
from recon.fixed import Fixed
from recon.photographs import ToneCurve
from recon.reconstruct import reconstruct
from recon.tone_grid import apply_curve, curve_values

COLUMNS = {
    "OE dB": ("ldr_psnr_oe", 2), "NE dB": ("ldr_psnr_ne", 2), "HDR dB, aligned": ("hdr_psnr_mu_aligned", 2),
    "response RMSE, %": ("response_rmse", 2), "s": ("train_seconds", 0),
}  # fmt: skip
C0, C0_WEIGHT = 0.73, 0.5


def sigmoid(power: float, residual: float | None) -> Response:
    """`sigmoid(ln E k) ** power` as a response; a residual says that it is known."""
    codes = np.arange(1, 255) / 255
    whole = codes ** (1 / power)
    logs = tuple(np.log(whole / (1 - whole)).tolist())
    return Response(
        kind="curve", codes=tuple(codes.tolist()), log_exposure=(logs,) * 3, valid=(5 / 255, 250 / 255),
        evidence="a sigmoid", residual=residual,
    )  # fmt: skip


class Pinned(ToneCurve):
    """With the unit exposure loss of the paper."""

    def penalty(self) -> Tensor | float:
        """Roughness, and how far the curve is from C0 at unit exposure."""
        unit = torch.tensor([-self.rate * self.middle])
        values = curve_values(self.theta if self._training() else self.theta.detach())
        at_one = torch.cat([apply_curve(unit, one, self.nodes, leaky=True) for one in values.flatten(0, -2)])
        return super().penalty() + C0_WEIGHT * (at_one - C0).square().mean()


@dataclass(frozen=True)
class Row:
    """response: what calibration.json says; None: measured."""

    response: Response | None
    within: Callable[[], Any] = nullcontext


SRGB = Response(kind="srgb", evidence="assumed")
ROWS: dict[str, Row] = {
    "measured": Row(None),
    "learned from sRGB on": Row(SRGB),
    "learned from sRGB on, C0 pinned": Row(SRGB, lambda: mock.patch("recon.photographs.ToneCurve", Pinned)),
    "learned from a sigmoid on (the paper)": Row(sigmoid(1.0, None)),
    "the true curve": Row(sigmoid(1 / 2.2, 1e-4)),
}
PROTOCOLS = ("exp-3", "exp-1")


def session(base: Path, scene: Path, protocol: str, row: Row, name: str, seed: int) -> Path:
    """The photographs with a response in their calibration."""
    photos = photographs(scene, base / "exp-3")
    plain = photos if protocol == "exp-3" else one_exposure_each(photos, base / "exp-1", scene, seed)
    folder = base / f"{protocol}-{name.replace(' ', '-').replace(',', '')}"
    if not folder.exists():
        with store.replacing(folder) as part:
            shutil.copytree(plain, part, ignore=shutil.ignore_patterns("reconstructions"))
            if row.response is None:
                calibrate(part, only="response")
            else:
                record = read_calibration(part)
                cameras = tuple(c.model_copy(update={"response": row.response}) for c in record.cameras)
                record = record.model_copy(update={"cameras": cameras})
                store.write_json(part / "calibration" / "calibration.json", record.model_dump(mode="json"))
    return folder


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"ablation-hdr-gs-{options.size.pixels}-{options.iterations}.jsonl")
    rows: dict[str, list[Any]] = {}
    for protocol in options.protocols:
        for name, row in ROWS.items():
            for seed in range(options.seeds):

                def train(
                    protocol: str = protocol, name: str = name, row: Row = row, seed: int = seed
                ) -> Any:
                    base = options.work / f"ablation-hdr-gs-{options.size.pixels}" / str(seed)
                    write_scene(base / "scene", options.size, seed)
                    folder = session(base, base / "scene", protocol, row, name, seed)
                    with row.within():
                        found = evaluate(
                            reconstruct(
                                folder, method="hdr-gs", seed=seed, fixed=Fixed(iterations=options.iterations)
                            )
                        )
                    return {key: found[key] for key, _ in COLUMNS.values() if key in found}

                rows.setdefault(f"{name}, {protocol.capitalize()}", []).append(
                    cache.get(f"{protocol} {name} {seed}", train)
                )
    return {"machine": machine(), "options": {"pixels": options.size.pixels, "seeds": options.seeds,
            "iterations": options.iterations}, "rows": rows}  # fmt: skip


def report(result: dict[str, Any]) -> str:
    told = result["options"]
    lines = [
        "# HDR-GS, one choice changed at a time",
        "",
        f"`python bench/ablation_hdr_gs.py --write`: HDR-NeRF's protocol, {told['pixels']} px, "
        f"{told['seeds']} seeds, {told['iterations']} iterations, means. {words(result['machine'])}.",
        "",
        "| curve | " + " | ".join(COLUMNS) + " |",
        "|---|" + "---|" * len(COLUMNS),
    ]
    for name, rows in result["rows"].items():
        cells = [
            f"{np.mean([row[key] * (100 if key == 'response_rmse' else 1) for row in rows]):.{digits}f}"
            for key, digits in COLUMNS.values()
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--pixels", type=int, default=100)
    parser.add_argument("--iterations", type=int, default=1000)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.size, options.protocols = Size(options.pixels, 7, 5), PROTOCOLS
    if options.quick:
        options.size, options.protocols, options.seeds, options.iterations = Size(48, 4, 3), ("exp-3",), 1, 60
    result = measure(options)
    deliver(options, "ablation_hdr_gs", result, report(result))


if __name__ == "__main__":
    main()
