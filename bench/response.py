"""Response curves: the ladder of rig beside OpenCV's estimators, on known curves and on real brackets.

    python bench/response.py [--quick] [--json] [--write]

Known curves: one simulated view of five decades in 7 exposures 2 EV apart, 20,000 electrons at white, 6 of
read noise, 8 bits; "shutter" rows with exposures that are 5 % (normal) off their labels. The error is the
standard deviation of ln light over codes 10..245, in the worst channel. Real brackets, where RIG_DATA names
their folder: `memorial` against its authors' radiance map, `t2i` by what overlapping exposures disagree.
"""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import memorial
import numpy as np
import numpy.typing as npt
from record import arguments, deliver, machine, words

from calib.codes import patches, sample
from calib.curve import channel_of, neighbours
from calib.response import Estimate, estimate
from imaging.colour import srgb_encode
from imaging.linear import decode, from_codes
from imaging.merge import merge_bracket
from imaging.photo import read_photo

Array = npt.NDArray[np.float64]
Codes = npt.NDArray[np.uint8]

FAMILIES: dict[str, Callable[[Array], Array]] = {
    "sRGB": srgb_encode,
    "gamma 2.2": lambda x: x ** (1 / 2.2),
    "BT.709": lambda x: np.where(x < 0.018, 4.5 * x, 1.099 * np.maximum(x, 1e-9) ** 0.45 - 0.099),
    "S-curve": lambda x: 1.21 * x**1.12 / (x**1.12 + 0.21),
    "log": lambda x: np.log1p(60 * x) / np.log(61),
}
LABELS = np.log(4.0 ** np.arange(-3, 4) / 2)
FULL_WELL, READ = 20_000, 6
JITTER = 0.05
SITES = 4_000
LEVELS = np.arange(256)

PEERS: dict[str, Callable[[], Any]] = {
    "Debevec": cv2.createCalibrateDebevec,
    "Debevec 500": lambda: cv2.createCalibrateDebevec(500, 10.0, True),
    "Robertson": cv2.createCalibrateRobertson,
}
"""OpenCV's, with their defaults or, beside them, 500 random samples."""


def shoot(curve: Callable[[Array], Array], seed: int, jitter: float) -> list[Codes]:
    """A bracket of codes [240, 320, 3]."""
    rng = np.random.default_rng(seed)
    knots = rng.uniform(np.log(1e-3), np.log(100.0), (7, 10, 3))
    light = np.exp(cv2.resize(knots, (320, 240)) + 0.02 * rng.standard_normal((240, 320, 1)))
    shots = []
    for label in LABELS:
        mean = np.minimum(light * np.exp(label + jitter * rng.standard_normal()), 2.0) * FULL_WELL
        electrons = rng.poisson(mean) + READ * rng.standard_normal(mean.shape)
        shots.append(np.rint(255 * curve(np.clip(electrons / FULL_WELL, 0, 1))).astype(np.uint8))
    return shots


def ours(shots: Sequence[Codes], labels: Array) -> Estimate:
    return estimate(sample([patches(shot.astype(np.float32) / 255) for shot in shots], labels, SITES))


def logs_of(found: Estimate) -> Array:
    """ln light [256, 3] of the codes."""
    return np.log(np.maximum(decode(np.repeat(LEVELS[:, None] / 255, 3, 1), found.response), 1e-12)).astype(
        float
    )


def truth(curve: Callable[[Array], Array]) -> Array:
    light = np.geomspace(1e-7, 1, 200_000)
    return np.interp(LEVELS / 255, curve(light), np.log(light))


def error(logs: Array, curve: Callable[[Array], Array]) -> float:
    return float((logs - truth(curve)[:, None])[10:246].std(0).max())


def coverage(found: Estimate, curve: Callable[[Array], Array]) -> float | None:
    """Share of the measured codes whose true value lies in the 95 % band; None where there is no curve."""
    response = found.response
    if not response.sigma:
        return None
    codes = np.rint(255 * np.array(response.codes)).astype(int)
    away = np.array(response.log_exposure) - truth(curve)[codes]
    away -= away[:, codes == 128]
    told = (codes >= 255 * response.valid[0]) & (codes <= 255 * response.valid[1]) & (abs(codes - 128) > 6)
    return float((np.abs(away) < 1.96 * np.array(response.sigma))[:, told].mean())


def family(name: str, seeds: Sequence[int], jitter: float) -> dict[str, Any]:
    curve = FAMILIES[name]
    row: dict[str, Any] = {
        "curve": name,
        "jitter": jitter,
        "rungs": [],
        "coverage": [],
        "ours": [],
        "seconds": [],
    }
    for seed in seeds:
        shots = shoot(curve, seed, jitter)
        began = time.perf_counter()
        found = ours(shots, LABELS)
        row["seconds"].append(time.perf_counter() - began)
        row["ours"].append(error(logs_of(found), curve))
        row["rungs"].append(
            "sRGB" if found.response.kind == "srgb" else found.response.evidence.split(",")[0]
        )
        row["coverage"].append(coverage(found, curve))
        for peer, make in PEERS.items():
            response = make().process(shots, np.exp(LABELS).astype(np.float32))
            row.setdefault(peer, []).append(error(np.log(np.maximum(response[:, 0], 1e-12)), curve))
    return row


def church(folder: Path) -> dict[str, Any]:
    """`memorial`: stops from the authors' map; the codes of the borders are made white, which no one uses."""
    shot, goal = memorial.series(folder), memorial.radiance(folder / "memorial.hdr")
    masked = [np.where(shot.valid[..., None], codes, np.uint8(255)) for codes in shot.codes]
    began = time.perf_counter()
    found = ours(masked, np.log(shot.times))
    seconds = time.perf_counter() - began
    k = [time * np.exp(found.shift.get(round(float(np.log(time)), 6), 0.0)) for time in shot.times]
    frames = [
        from_codes(code.astype(np.float32) / 255, scale, found.response)
        for code, scale in zip(shot.codes, k, strict=True)
    ]
    merged = merge_bracket(frames)
    row: dict[str, Any] = {
        "told": float(np.isfinite(goal).mean()),
        "seconds": seconds,
        "evidence": found.response.evidence,
        "rungs": [rung.model_dump() for rung in found.rungs],
        "ours": memorial.stops(merged.radiance, goal, shot.valid & merged.valid.all(-1)),
    }
    times = shot.times.astype(np.float32)
    for peer, make in PEERS.items():
        response = make().process(shot.codes, times)
        merge = cv2.createMergeRobertson() if peer == "Robertson" else cv2.createMergeDebevec()
        row[peer] = memorial.stops(merge.process(shot.codes, times, response), goal, shot.valid)
    return row


def room(folder: Path) -> dict[str, Any]:
    """`t2i`: median disagreement, %, of neighbouring exposures of the same photosites."""
    photos = [read_photo(path) for path in sorted(folder.glob("*.jpg"))]
    exposures = [photo.metadata.exposure for photo in photos]
    labels = np.log([exposure.scale for exposure in exposures if exposure is not None])
    samples = sample([patches(photo.pixels) for photo in photos], labels, SITES)
    found = estimate(samples)
    shift = np.array([found.shift.get(round(float(label), 6), 0.0) for label in labels])

    def disagreement(logs: Array, shifts: Array) -> float:
        steps = np.sort(labels)
        moved = dict(zip(steps.round(6), shifts[np.argsort(labels)], strict=True))
        parts = []
        for index in range(3):
            channel = channel_of(samples, index)
            own = np.array([moved[step] for step in channel.steps.round(6)])[channel.step]
            light = np.interp(channel.code, LEVELS, logs[:, index]) - channel.log_k - own
            first, second = neighbours(channel)
            parts.append(np.abs(light[first] - light[second]))
        return 100 * float(np.median(np.concatenate(parts)))

    row: dict[str, Any] = {
        "evidence": found.response.evidence,
        "rungs": [rung.model_dump() for rung in found.rungs],
        "ours": disagreement(logs_of(found), shift),
    }
    shots = [np.rint(255 * photo.pixels).astype(np.uint8) for photo in photos]
    for peer, make in PEERS.items():
        response = make().process(shots, np.exp(labels).astype(np.float32))
        row[peer] = disagreement(np.log(np.maximum(response[:, 0], 1e-12)).astype(float), 0 * shift)
    return row


def table(result: dict[str, Any]) -> str:
    lines = [
        "# Response curves",
        "",
        f"`python bench/response.py --write`: {result['seeds']} seeds a curve, medians. "
        f"{words(result['machine'])}.",
        "",
        "Error of ln light over codes 10..245, %. Shapes: what the ladder took. In the band: codes whose "
        "truth lies in the 95 % band.",
        "",
        "| curve | shutter off by | rig | worst seed | shapes | in the band, % | s | "
        + " | ".join(f"OpenCV {peer}" for peer in PEERS)
        + " |",
        "|" + "---|" * (7 + len(PEERS)),
    ]
    for row in result["families"]:
        covered = [value for value in row["coverage"] if value is not None]
        inside = f"{100 * np.mean(covered):.0f}" if covered else "-"
        shapes = ", ".join(f"{row['rungs'].count(shape)} x {shape}" for shape in sorted(set(row["rungs"])))
        peers = " | ".join(f"{100 * np.median(row[peer]):.1f}" for peer in PEERS)
        lines.append(
            f"| {row['curve']} | {100 * row['jitter']:.0f} % | {100 * np.median(row['ours']):.2f} | "
            f"{100 * max(row['ours']):.2f} | {shapes} | {inside} | {np.median(row['seconds']):.1f} "
            f"| {peers} |"
        )
    if "memorial" in result:
        lines += ["", "| real bracket | rig | " + " | ".join(f"OpenCV {peer}" for peer in PEERS) + " |"]
        lines.append("|" + "---|" * (2 + len(PEERS)))
        for name, unit in (("memorial", "stops from the authors' map"), ("t2i", "% between exposures")):
            row = result[name]
            values = " | ".join(f"{row[key]:.3g}" for key in ("ours", *PEERS))
            lines.append(f"| {name}, {unit} | {values} |")
        told = 100 * result["memorial"]["told"]
        lines += [
            "",
            f"memorial: {result['memorial']['evidence']}; {told:.0f} % of the authors' map is readable.",
        ]
        lines += [f"t2i: {result['t2i']['evidence']}."]
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    seeds = range(1 if options.quick else 6)
    jitters = (0.0,) if options.quick else (0.0, JITTER)
    families = [family(name, seeds, jitter) for jitter in jitters for name in FAMILIES]
    result: dict[str, Any] = {"machine": machine(), "seeds": len(seeds), "families": families}
    data = os.environ.get("RIG_DATA")
    if data:
        result |= {"memorial": church(Path(data) / "memorial"), "t2i": room(Path(data) / "t2i")}
    deliver(options, "response", result, table(result))


if __name__ == "__main__":
    main()
