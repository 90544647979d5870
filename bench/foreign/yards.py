"""Yards against the sun: errors of held-out light by band, with and without what stands far away.

    python -m bench.foreign.yards [--quick] [--json] [--write] [--seeds 3] [--work FOLDER]
        [--variants "as decided;colours of 3DGS"]

Two path-traced yards of 23 stops (`tests/foreign/yards.py`), the sun behind a wall or over a roof and a dark
room behind a door: 24 views of 160 px with given poses, as RAW or JPEG brackets or one RAW a view, trained on
at 80 px by the preset draft with fewer Gaussians, or by the preset standard as it is. Only RAW brackets, as
decided, are trained with every seed. --quick: RAW brackets with 40 iterations. Finished rows are kept in
FOLDER.
"""

import argparse
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.arrays import Array32
from imaging.files.exr.reading import read_exr
from recon.decide.overrides import Overrides
from recon.decide.presets import MethodName, QualityName
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.methods import nh_3dgs
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.scene.appearance import Rate
from rig.__main__ import main as rig
from tests.foreign import judge, yards
from tests.foreign.folder import Body, photograph, tell_poses
from tests.foreign.lit import LitScene

WIDTH, GAUSSIANS, ITERATIONS = 80, 5000, 300
YARDS: dict[str, Callable[..., LitScene]] = {"low-sun": yards.low_sun, "high-sun": yards.high_sun}
BRACKET = ((1 / 8000, 1 / 500, 1 / 30, 1 / 2, 8.0),)
BY_TURNS = tuple((seconds,) for seconds in BRACKET[0])
BANDS = {
    "darkest tenth": "stops_dark",
    "middle": "stops_middle",
    "brightest 1 %": "stops_bright",
    "brightest 0.1 %": "stops_brightest",
}
PARTS = {"room": ("room",), "sky": ("background",)}


@dataclass(frozen=True)
class Kind:
    """Photographs of a yard: camera and exposures."""

    title: str
    body: Body
    times: tuple[tuple[float, ...], ...]
    developed: bool = False


KINDS = {
    "raw": Kind("RAW brackets", Body(14, seed=5, seconds=4.0), BRACKET),
    "single": Kind("RAW, one exposure a view", Body(14, seed=5, seconds=4.0), BY_TURNS),
    "jpeg": Kind("JPEG brackets", Body(seed=6, seconds=4.0, well=20_000.0), BRACKET, developed=True),
}


def session(work: Path, name: str, kind: str) -> Path:
    """The photographs of a yard, imported and calibrated, with their truth."""
    made, scene = KINDS[kind], YARDS[name]()
    folder = work / f"{name}-{kind}"
    if (folder / "S" / "truth" / "truth.json").exists():
        return folder / "S"
    shutil.rmtree(folder, ignore_errors=True)
    light = scene.light()
    shots = photograph(folder / "photos", light, made.body, made.times, developed=made.developed)
    size = scene.width, scene.height
    tell_poses(shots, scene.poses, scene.focal, size, scene.surface_points())
    rig(["import", str(shots.folder), str(folder / "S")])
    rig(["calibrate", str(folder / "S"), "--only", "response"])
    judge.tell_truth(folder / "S", light, scene.poses, shots, developed=made.developed)
    return folder / "S"


@contextmanager
def patched(where: str, value: Any) -> Iterator[None]:
    """Another constant or function while a row is trained."""
    with mock.patch(where, value):
        yield


AS_DECIDED = "as decided"
STANDARD = "standard"
FAR = Overrides(environment=True)
"""The far field taken, as the trial decides in both yards. It is made where RAW is trained as decided with
the first seed."""


@dataclass(frozen=True)
class Variant:
    """Differences of a row from the others."""

    overrides: Overrides = FAR
    within: Callable[[], Any] = nullcontext
    method: MethodName = "auto"
    kinds: tuple[str, ...] = ("raw",)
    iterations: int | None = None
    quality: QualityName = "draft"
    whole: bool = False
    """The preset's own width, iterations and number of Gaussians, with its trials."""


MU = partial(patched, "recon.observe.linear.SIGNAL_MU")
FASTER = replace(nh_3dgs.APPEARANCE, chroma_rate=Rate(0.12, 0.012))
VARIANTS = {
    AS_DECIDED: Variant(kinds=tuple(KINDS)),
    "colours of 3DGS": Variant(method="vanilla", kinds=("raw", "single")),
    "no far field": Variant(Overrides(environment=False)),
    "chroma four times as fast": Variant(within=partial(patched, "recon.methods.nh_3dgs.APPEARANCE", FASTER)),
    "1,000 iterations": Variant(iterations=1000),
    "mu of 125": Variant(within=partial(MU, 125.0), kinds=("raw", "single")),
    "mu of 2,000": Variant(within=partial(MU, 2000.0), kinds=("raw", "single")),
    "mu of 8,000": Variant(within=partial(MU, 8000.0), kinds=("raw", "single")),
    STANDARD: Variant(Overrides(), kinds=tuple(KINDS), quality="standard", whole=True),
}


def trained(place: Path, name: str, seed: int, variant: Variant, iterations: int) -> dict[str, Any]:
    """A row of one training: errors by band and of parts, and whether there is a far field."""
    sized = {"width": WIDTH, "gaussians": GAUSSIANS, "iterations": variant.iterations or iterations}
    overrides = variant.overrides if variant.whole else variant.overrides.model_copy(update=sized)
    with variant.within():
        folder = reconstruct(
            place,
            TrainingRequest(
                method=variant.method,
                quality=variant.quality,
                seed=seed,
                overrides=overrides,
                name="scene",
                replace=True,
            ),
        )
    figures = evaluate(folder).known()
    return {
        **{key: figures[key] for key in (*BANDS.values(), "stops_median", "hdr_psnr_mu_p999")},
        **of_parts(folder, YARDS[name](), figures["alignment_scale"]),
        "far": any(rung.taken for rung in read_model(folder).rungs if rung.name == "environment"),
    }


def of_parts(folder: Path, scene: LitScene, scale: float) -> dict[str, float]:
    """Median errors, stops, of held-out renders at what is seen of each part, and whether they are too dark.

    `_signed`: the median of the ratio itself, below 0 where renders are too dark. scale: aligns them.
    """
    logs: dict[str, list[Array32]] = {part: [] for part in PARTS}
    for path in sorted((folder / "renders").glob("*.exr")):
        ours, frame = scale * read_exr(path).rgb().mean(-1), int(path.stem[:4])
        step = scene.width // ours.shape[1]

        def tiles(image: Any, step: int = step) -> Any:
            return image.reshape(image.shape[0] // step, step, image.shape[1] // step, step)

        true = tiles(scene.light()[frame].mean(-1)).mean((1, 3))
        for part, names in PARTS.items():
            there = tiles(scene.where(*names)[frame]).all((1, 3))
            logs[part].append(np.log2(np.maximum(ours, 1e-9) / true)[there])
    errors = {}
    for part, ratios in logs.items():
        together = np.concatenate(ratios)
        errors[f"stops_{part}"] = float(np.median(np.abs(together)))
        errors[f"signed_{part}"] = float(np.median(together))
    return errors


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each variant on each set of photographs."""
    cache = Cache(options.work / f"yards-{options.iterations}.jsonl")
    rows = []
    for title in options.variants:
        for kind, name, seed in product(VARIANTS[title].kinds[: options.kinds], YARDS, range(options.seeds)):
            if seed > 0 and (kind, title) != ("raw", AS_DECIDED):
                continue
            variant = VARIANTS[title]
            if title == AS_DECIDED and seed == 0 and kind != "jpeg":
                variant = replace(variant, overrides=Overrides())

            def train(
                name: str = name, kind: str = kind, seed: int = seed, variant: Variant = variant
            ) -> Any:
                return trained(session(options.work, name, kind), name, seed, variant, options.iterations)

            row = cache.get(f"{name} {kind} {seed} {title}", train)
            rows.append({"yard": name, "kind": kind, "seed": seed, "variant": title} | row)
    return {"machine": machine(), "iterations": options.iterations, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Yards against the sun",
        "",
        "`python -m bench.foreign.yards --write`: two path-traced yards of 23 stops, 24 views, given poses; "
        f"preset draft at {WIDTH} px with {GAUSSIANS:,} Gaussians and {result['iterations']} iterations, "
        "or, in rows of `standard`, that preset as it is. "
        f"{words(result['machine'])}.",
        "",
        "Median errors of held-out light by how bright it is, stops; the room behind the door, and the sky, "
        "where in brackets is by how much it is too bright. dB are of the mu-law over the 99.9th percentile.",
        "",
        f"| yard | photographs | seed | trained | far field | dB | {' | '.join(BANDS)} | room | sky |",
        "|---" * (8 + len(BANDS)) + "|",
    ]
    for row in result["rows"]:
        cells = [row["yard"], KINDS[row["kind"]].title, str(row["seed"]), row["variant"]]
        cells += ["yes" if row["far"] else "no", f"{row['hdr_psnr_mu_p999']:.1f}"]
        cells += [f"{row[key]:.3f}" for key in BANDS.values()]
        cells += [f"{row[f'stops_{part}']:.3f} ({row[f'signed_{part}']:+.2f})" for part in PARTS]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=3)
    parser.add_argument("--variants", default=";".join(VARIANTS), help="by semicolons")
    options = parser.parse_args()
    options.variants = tuple(options.variants.split(";"))
    options.kinds, options.iterations = len(KINDS), ITERATIONS
    if options.quick:
        options.kinds, options.iterations, options.variants = 1, 40, ("as decided",)
    result = measure(options)
    deliver(options, "yards", result, report(result))


if __name__ == "__main__":
    main()
