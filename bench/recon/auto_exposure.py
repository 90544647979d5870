"""Photographs that their camera exposed and balanced by itself: the gain by modelling that.

    python -m bench.recon.auto_exposure [--quick] [--json] [--write] [--seeds 2] [--work FOLDER]

The demo's views, a photograph each, through sRGB, without labels; each brighter or darker and of another
white balance as drawn. `labels`: the calibration's poses and falloff, photographs taken as equally exposed
and balanced. `own`: as in the calibration (`calib/light/each_photograph.py`), by either method. Held-out
views are compared with the simulator's light where it is not among the brightest tenth, after one scale a
scene.
"""

import argparse
import shutil
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.oracle import oracle_session
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from capture.imports.request import ImportRequest
from imaging.arrays import Array
from imaging.colour.spaces import srgb_encode
from imaging.files import store
from imaging.files.exr.reading import read_exr
from imaging.files.photo import encode_png
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from recon.decide.presets import MethodName
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.scene import open_scene


@dataclass(frozen=True)
class Case:
    """Standard deviations over the photographs, natural log: of the exposure, and of each channel beside."""

    exposure: float
    balance: float


CASES = {
    "all alike": Case(0.0, 0.0),
    "auto exposure": Case(0.35, 0.0),
    "auto white balance": Case(0.0, 0.12),
    "both": Case(0.35, 0.12),
}
METHODS: tuple[MethodName | None, ...] = (None, "vanilla", "hdr-gs")
MIDDLE = 0.25
"""Mean of an average photograph, relative to the scene's median radiance, linear."""


def photographed(base: Path, case: Case, seed: int, frames: int) -> tuple[Path, Array]:
    """A folder of photographs, and the factors [V, 3] that they were developed with."""
    truth = sorted(oracle_session(base / "demo", "demo", seed=seed, frames=frames).glob("truth/**/*.exr"))
    rng = np.random.default_rng([seed, 0xA3])
    logs = case.exposure * rng.standard_normal((len(truth), 1))
    logs = logs + case.balance * rng.standard_normal((len(truth), 3))
    factors = np.exp(logs - logs.mean(axis=0))
    lights = [read_exr(path).rgb() for path in truth]
    scale = MIDDLE / float(np.median(np.stack(lights)))
    folder = base / "photographs"
    for number, (light, factor) in enumerate(zip(lights, factors, strict=True)):
        codes = np.rint(255 * srgb_encode(np.clip(light * factor * scale, 0, 1)))
        store.write_bytes(folder / f"{number:03d}.png", encode_png(codes.astype(np.uint8)))
        store.write_bytes(base / "light" / f"{number:03d}.exr", truth[number].read_bytes())
    return folder, factors


def trained(options: argparse.Namespace, name: str, method: MethodName | None, seed: int) -> dict[str, Any]:
    """Figures of one training; method: None for that which is chosen of photographs as labelled."""
    base = options.work / f"auto-exposure-{options.frames}" / str(seed) / name.replace(" ", "-")
    session = base / "S"
    if not (session / "calibration" / "calibration.json").exists():
        folder, factors = photographed(base, CASES[name], seed, options.frames)
        import_photos(folder, session, ImportRequest(bracket=1))
        calibrate(session)
        store.write_json(base / "factors.json", factors.tolist())
    factors = np.array(store.read_json(base / "factors.json"))
    record = read_calibration(session)
    shots = {shot.view: shot for shot in Session.open(session).shots("scene")}
    number = {view.id: int(Path(shots[view.id].source or "").stem) for view in record.views}
    estimated = np.array([view.exposure * np.array(view.white_balance) for view in record.views])
    off = np.log(estimated / factors[[number[view.id] for view in record.views]])
    row: dict[str, Any] = {"placed": len(record.views), "factors_off": float(np.std(off - off.mean(axis=0)))}
    if method is None:
        session = base / "labels"
        shutil.rmtree(session, ignore_errors=True)
        shutil.copytree(base / "S", session, ignore=shutil.ignore_patterns("reconstructions"))
        scale = dict(record.exposure_scale)
        for view in record.views:
            scale[shots[view.id].file] /= view.exposure
        alike = [
            view.model_copy(update={"exposure": 1.0, "white_balance": (1.0, 1.0, 1.0)})
            for view in record.views
        ]
        record = record.model_copy(update={"views": tuple(alike), "exposure_scale": scale})
        store.write_json(session / "calibration" / "calibration.json", record.model_dump(mode="json"))
    made = reconstruct(
        session,
        TrainingRequest(method=method or "auto", quality="draft", seed=seed, name="scene", replace=True),
    )
    used = open_scene(made).record.settings.method
    return row | {"method": used} | light_errors(made, base / "light", number)


def light_errors(made: Path, lights: Path, number: dict[Any, int]) -> dict[str, float]:
    """Stops in the median, and mu-law PSNR over the truth's maximum, of the held-out views' light."""
    scene = open_scene(made)
    pairs = []
    for view in scene.views:
        if view.use == "training":
            continue
        light = read_exr(lights / f"{number[view.id]:03d}.exr").rgb()
        pairs.append((scene.render(view.splat_camera), light))
    mine, true = (np.stack(part).astype(np.float64) for part in zip(*pairs, strict=True))
    usual = true.max(axis=-1) < np.quantile(true.max(axis=-1), 0.9)
    ratio = np.log2(np.maximum(mine, 1e-9) / np.maximum(true, 1e-9))[usual]
    ratio -= np.median(ratio)
    return {"stops": float(np.median(np.abs(ratio))), "stops_p90": float(np.quantile(np.abs(ratio), 0.9))}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / f"auto-exposure-{options.frames}.jsonl")
    rows = [
        {
            "photographs": name,
            "known": "labels" if method is None else "own",
            "trainings": [
                cache.get(f"{name} {method} {seed}", partial(trained, options, name, method, seed))
                for seed in range(options.seeds)
            ],
        }
        for name in CASES
        for method in METHODS
    ]
    return {"machine": machine(), "seeds": options.seeds, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Photographs that the camera exposed and balanced by itself",
        "",
        f"`python -m bench.recon.auto_exposure --write`: the demo's views, one photograph each, quality "
        f"draft, means over {result['seeds']} seeds. {words(result['machine'])}.",
        "",
        "Exposures scatter by half a stop, channels by 12 %. `labels`: as if all were alike; `own`: by the",
        "points that the photographs share. Light of held-out views, the brightest tenth left out, after one",
        "scale.",
        "",
        "| photographs | taken as | method | factors off, % | stops, median | stops, 90 % |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        off, stops, high = (
            np.mean([one[key] for one in row["trainings"]]) for key in ("factors_off", "stops", "stops_p90")
        )
        error = f"{100 * off:.1f}" if row["known"] == "own" else ""
        lines.append(
            f"| {row['photographs']} | {row['known']} | {row['trainings'][0]['method']} | {error} "
            f"| {stops:.3f} | {high:.3f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__, seeds=2).parse_args()
    options.frames = 3 if options.quick else 6
    options.seeds = 1 if options.quick else options.seeds
    result = measure(options)
    deliver(options, "auto_exposure", result, report(result))


if __name__ == "__main__":
    main()
