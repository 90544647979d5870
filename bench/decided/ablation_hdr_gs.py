"""HDR-GS, one choice changed at a time, on HDR-NeRF's protocol: where its curve starts from, and the loss.

    python -m bench.decided.ablation_hdr_gs [--quick] [--json] [--write] [--seeds 2] [--pixels 100]
                                    [--iterations 1000] [--work FOLDER]

Scenes as in bench/recon/hdr_nerf_protocol.py. Exp-3: all three exposures of a view; Exp-1: one each.
`measured`: by `rig calibrate --only response` from the photographs of the training. C0 is the term of the
paper that pins the curve's value at unit exposure to the truth's, with its weight of 0.5. Balance:
`ToneCurve` says what of. NH-3DGS sees the true light of the training views. Finished rows are kept in FOLDER.
"""

import argparse
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from torch import Tensor

from bench.decided.variants import curve_of_gaussians
from bench.recon.hdr_nerf_protocol import one_exposure_each, photographs, true_light, with_measured_response
from bench.support.hdr_nerf_scene import Size, write_scene
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.files import store
from imaging.session.calibration import Response, read_calibration
from recon.decide.overrides import Overrides
from recon.evaluate import evaluate
from recon.observe.photographs import LAST_CODE, ToneCurve
from recon.observe.tone_grid import apply_curve, curve_values
from recon.reconstruct import MethodName, reconstruct

COLUMNS = {
    "OE dB": ("ldr_psnr_oe", 2), "NE dB": ("ldr_psnr_ne", 2), "HDR dB, aligned": ("hdr_psnr_mu_aligned", 2),
    "response RMSE, %": ("response_rmse", 2), "s": ("train_seconds", 0),
}  # fmt: skip
C0, C0_WEIGHT = 0.73, 0.5
GAUSSIANS = 10_000


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
    """Loss with the unit exposure loss of the paper."""

    def penalty(self, progress: float) -> Tensor | float:
        """Roughness, and how far the curve is from C0 at unit exposure."""
        unit = torch.tensor([-self.rate * self.middle])
        values = curve_values(self.theta if self.moves(progress) else self.theta.detach())
        at_one = torch.cat([apply_curve(unit, one, self.nodes, leaky=True) for one in values.flatten(0, -2)])
        return super().penalty(progress) + C0_WEIGHT * (at_one - C0).square().mean()


@dataclass(frozen=True)
class Row:
    """Row. response: that of calibration.json; None: measured. ssim: its weight in the loss; None: the
    default.
    """

    response: Response | None = None
    within: Callable[[], Any] = nullcontext
    ssim: float | None = None


@contextmanager
def balance(value: float, bounds: float = LAST_CODE) -> Iterator[None]:
    """Another balance; bounds: how near to an end of the scale a code that was flagged is only a bound."""
    with (
        mock.patch("recon.observe.calibrated_curves.ToneCurve", partial(ToneCurve, balance=value)),
        mock.patch("recon.observe.photographs.LAST_CODE", bounds),
    ):
        yield


NH = "NH-3DGS on the true light"
SRGB = Response(kind="srgb", evidence="assumed")
ROWS: dict[str, Row] = {
    "measured": Row(),
    "learned from sRGB on": Row(SRGB),
    "learned from sRGB on, C0 pinned": Row(
        SRGB, lambda: mock.patch("recon.observe.calibrated_curves.ToneCurve", Pinned)
    ),
    "learned from a sigmoid on (the paper)": Row(sigmoid(1.0, None)),
    "the true curve": Row(sigmoid(1 / 2.2, 1e-4)),
    "balance 0: codes as they are": Row(within=lambda: balance(0.0)),
    "balance 1: ratios of light": Row(within=lambda: balance(1.0)),
    "balance 0, codes beyond the calibration are bounds": Row(within=lambda: balance(0.0, bounds=9.0)),
    "SSIM weight 0": Row(ssim=0.0),
    "SSIM weight 0.2 (the paper)": Row(ssim=0.2),
    "the curve on every Gaussian too (GaussHDR)": Row(within=curve_of_gaussians),
    NH: Row(),
}
PROTOCOLS = ("exp-3", "exp-1")


def session(base: Path, scene: Path, protocol: str, row: Row, name: str, seed: int) -> Path:
    """The photographs with a response in their calibration; or the light."""
    photos = photographs(scene, base / "exp-3")
    if name == NH:
        return true_light(photos, base / "light")
    plain = photos if protocol == "exp-3" else one_exposure_each(photos, base / "exp-1", scene, seed)
    if row.response is None:
        return with_measured_response(plain, base / f"{protocol}-measured")
    folder = base / f"{protocol}-{slug(name)}"
    if not folder.exists():
        with store.replacing(folder) as part:
            shutil.copytree(plain, part, ignore=shutil.ignore_patterns("reconstructions"))
            record = read_calibration(part)
            cameras = tuple(c.model_copy(update={"response": row.response}) for c in record.cameras)
            record = record.model_copy(update={"cameras": cameras})
            store.write_json(part / "calibration" / "calibration.json", record.model_dump(mode="json"))
    return folder


def slug(name: str) -> str:
    """The name as that of a folder."""
    return "-".join(re.findall(r"[A-Za-z0-9.]+", name))


def trained(options: argparse.Namespace, protocol: str, name: str, seed: int) -> dict[str, Any]:
    """The figures of one training."""
    row = ROWS[name]
    base = options.work / f"ablation-hdr-gs-{options.size.pixels}" / str(seed)
    write_scene(base / "scene", options.size, seed)
    folder = session(base, base / "scene", protocol, row, name, seed)
    overrides = Overrides(iterations=options.iterations, gaussians=GAUSSIANS, ssim=row.ssim)
    method: MethodName = "nh-3dgs" if name == NH else "hdr-gs"
    with row.within():
        made = reconstruct(
            folder, method=method, seed=seed, overrides=overrides, name=slug(name), replace=True
        )
        found = evaluate(made).known()
    return {key: found[key] for key, _ in COLUMNS.values() if key in found}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"ablation-hdr-gs-{options.size.pixels}-{options.iterations}.jsonl")
    rows: dict[str, list[Any]] = {}
    for protocol, name, seed in product(options.protocols, ROWS, range(options.seeds)):
        if name == NH and protocol != options.protocols[0]:
            continue  # it sees no exposures
        key = f"{protocol} {name} {seed}"
        print(key, file=sys.stderr)
        title = name if name == NH else f"{name}, {protocol.capitalize()}"
        rows.setdefault(title, []).append(cache.get(key, partial(trained, options, protocol, name, seed)))
    return {"machine": machine(), "options": {"pixels": options.size.pixels, "seeds": options.seeds,
            "iterations": options.iterations}, "rows": rows}  # fmt: skip


def report(result: dict[str, Any]) -> str:
    options = result["options"]
    lines = [
        "# HDR-GS, one choice changed at a time",
        "",
        f"`python -m bench.decided.ablation_hdr_gs --write`: HDR-NeRF's protocol, {options['pixels']} px, "
        f"{options['seeds']} seeds, {GAUSSIANS} Gaussians, {options['iterations']} iterations, means. "
        f"{words(result['machine'])}.",
        "",
        "| changed | " + " | ".join(COLUMNS) + " |",
        "|---|" + "---|" * len(COLUMNS),
    ]
    for name, rows in result["rows"].items():
        cells = []
        for key, digits in COLUMNS.values():
            values = [row[key] * (100 if key == "response_rmse" else 1) for row in rows if key in row]
            cells.append(f"{np.mean(values):.{digits}f}" if values else "")
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
