"""Response curves: the ladder of rig beside OpenCV's estimators, on known curves and on real brackets.

    python -m bench.calibration.light.response [--quick] [--json] [--write]

Known curves: one simulated view of five decades in 7 exposures 2 EV apart, 20,000 electrons at white, 6 of
read noise, 8 bits; "shutter" rows with exposures that are 5 % (normal) off their labels. The error is the
standard deviation of ln light over codes 10..245, in the worst channel. Wide brackets: three exposures 3 and
4 stops apart through the curve of HDR-NeRF's rendered scenes, without noise; there the error over half a step
(root mean square) is that of exposures between the ones that were taken. "label" rows: four exposures 2 EV
apart, one of them, each in turn, labelled twice or half of what it is. Real brackets, where RIG_DATA names
their folder: `memorial` against its authors' radiance map, `t2i` by what overlapping exposures disagree.
"""

import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from bench.calibration.light import memorial
from bench.calibration.light.response_curves import (
    FAMILIES,
    LABELS,
    LEVELS,
    PEERS,
    SITES,
    error,
    logs_of,
    ours,
    shoot,
    truth,
)
from bench.support.hdr_nerf_scene import curve as curve_of_hdr_nerf
from bench.support.record import arguments, deliver, machine, words
from calib.light.curves.codes import Samples, patches, sample
from calib.light.curves.response import Estimate, estimate
from calib.light.curves.response_curve import channels_of, neighbours
from imaging.arrays import Array
from imaging.files.photo import read_photo
from imaging.merge.bracket import merge_bracket
from imaging.merge.linear_frame import from_codes

FOUR = LABELS[1:5]
WIDE = {3: np.log([1 / 4, 2, 16]), 4: np.log([1 / 8, 2, 32])}
"""Exposures, ln s, by stops apart; the second is HDR-NeRF's."""
VIEWS = 4
JITTER = 0.05


def sigmoid(light: Array) -> Array:
    """The curve of HDR-NeRF's rendered scenes."""
    return np.asarray(curve_of_hdr_nerf(np.log(np.maximum(light, 1e-12))))


def wide(stops: int, seeds: Sequence[int]) -> dict[str, Any]:
    """A bracket of three wide steps, of several views."""
    labels, light = WIDE[stops], np.geomspace(1e-7, 1e3, 400_000)
    goal = np.interp(LEVELS / 255, sigmoid(light), np.log(light))
    row: dict[str, Any] = {"stops": stops, "rungs": [], "ours": [], "half": []}
    row |= {key: [] for peer in PEERS for key in (peer, f"{peer} half")}
    for seed in seeds:
        rng = np.random.default_rng([seed, stops])
        views = []
        for _ in range(VIEWS):
            knots = rng.uniform(np.log(2e-3), np.log(160.0), (7, 10, 3))
            scene = np.exp(cv2.resize(knots, (320, 240)))
            views.append([np.rint(255 * sigmoid(scene * np.exp(k))).astype(np.uint8) for k in labels])
        cut = [[patches(shot.astype(np.float32) / 255) for shot in shots] for shots in views]
        estimated = estimate(Samples.joined([sample(shots, labels, SITES // VIEWS) for shots in cut]))
        row["rungs"].append(estimated.response.evidence.split(",")[0])
        curves = {"ours": logs_of(estimated)}
        joined = [np.concatenate(shots) for shots in zip(*views, strict=True)]
        for peer, make in PEERS.items():
            response = make().process(joined, np.exp(labels).astype(np.float32))
            curves[peer] = np.log(np.maximum(response[:, 0], 1e-12)).astype(float)
        for name, logs in curves.items():
            away = (logs - goal[:, None])[10:246]
            row[name].append(float(away.std(0).max()))
            row["half" if name == "ours" else f"{name} half"].append(half_step(away, goal[10:246], labels))
    return row


def half_step(away: Array, goal: Array, labels: Array) -> float:
    """Root mean square error of the difference of codes that are half a step of the bracket apart."""
    places = np.arange(len(goal))
    beyond = np.interp(goal + 0.5 * (labels[1] - labels[0]), goal, places, right=np.nan)
    across = np.stack([np.interp(beyond, places, channel) - channel for channel in away.T])
    return float(np.sqrt(np.nanmean(across**2, axis=1)).max())


def mislabelled(name: str, seed: int) -> dict[str, Any]:
    """The worst errors over the labels that are wrong, one at a time: of the curve, and of the exposures."""
    curve = FAMILIES[name]
    row: dict[str, Any] = {"curve": name, "ours": [], "others": [], "wrong": [], "named": []}
    for step in range(len(FOUR)):
        for factor in (2.0, 0.5):
            off = np.where(np.arange(len(FOUR)) == step, np.log(factor), 0.0)
            shots = shoot(curve, seed, 0.0, FOUR + off)
            estimated = ours(shots, FOUR)
            shift = np.array([estimated.shift.get(round(float(label), 6), 0.0) for label in FOUR]) - off
            row["ours"].append(error(logs_of(estimated), curve))
            row["others"].append(float(np.abs(np.delete(shift, step)).max()))
            row["wrong"].append(float(abs(shift[step])))
            words = f"exposure {step + 1} of {len(FOUR)}, counted"
            row["named"].append(any(words in rung.reason for rung in estimated.rungs))
    return row


def coverage(estimated: Estimate, curve: Callable[[Array], Array]) -> float | None:
    """Share of the measured codes whose true value lies in the 95 % band; None where there is no curve."""
    response = estimated.response
    if not response.sigma:
        return None
    codes = np.rint(255 * np.array(response.codes)).astype(int)
    away = np.array(response.log_exposure) - truth(curve)[codes]
    away -= away[:, codes == 128]
    judged = (codes >= 255 * response.valid[0]) & (codes <= 255 * response.valid[1]) & (abs(codes - 128) > 6)
    return float((np.abs(away) < 1.96 * np.array(response.sigma))[:, judged].mean())


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
        estimated = ours(shots, LABELS)
        row["seconds"].append(time.perf_counter() - began)
        row["ours"].append(error(logs_of(estimated), curve))
        row["rungs"].append(
            "sRGB" if estimated.response.kind == "srgb" else estimated.response.evidence.split(",")[0]
        )
        row["coverage"].append(coverage(estimated, curve))
        for peer, make in PEERS.items():
            response = make().process(shots, np.exp(LABELS).astype(np.float32))
            row.setdefault(peer, []).append(error(np.log(np.maximum(response[:, 0], 1e-12)), curve))
    return row


def church(folder: Path) -> dict[str, Any]:
    """`memorial`: stops from the authors' map; the codes of the borders are made white, which no one uses."""
    shot, goal = memorial.series(folder), memorial.radiance(folder / "memorial.hdr")
    masked = [np.where(shot.valid[..., None], codes, np.uint8(255)) for codes in shot.codes]
    began = time.perf_counter()
    estimated = ours(masked, np.log(shot.times))
    seconds = time.perf_counter() - began
    k = [time * np.exp(estimated.shift.get(round(float(np.log(time)), 6), 0.0)) for time in shot.times]
    frames = [
        from_codes(code.astype(np.float32) / 255, scale, estimated.response)
        for code, scale in zip(shot.codes, k, strict=True)
    ]
    merged = merge_bracket(frames)
    row: dict[str, Any] = {
        "readable": float(np.isfinite(goal).mean()),
        "seconds": seconds,
        "evidence": estimated.response.evidence,
        "rungs": [rung.model_dump() for rung in estimated.rungs],
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
    estimated = estimate(samples)
    shift = np.array([estimated.shift.get(round(float(label), 6), 0.0) for label in labels])

    def disagreement(logs: Array, shifts: Array) -> float:
        steps = np.sort(labels)
        moved = dict(zip(steps.round(6), shifts[np.argsort(labels)], strict=True))
        parts = []
        for index, channel in enumerate(channels_of(samples)):
            shift_of_step = np.array([moved[step] for step in channel.steps.round(6)])[channel.step]
            light = np.interp(channel.code, LEVELS, logs[:, index]) - channel.log_k - shift_of_step
            first, second = neighbours(channel)
            parts.append(np.abs(light[first] - light[second]))
        return 100 * float(np.median(np.concatenate(parts)))

    row: dict[str, Any] = {
        "evidence": estimated.response.evidence,
        "rungs": [rung.model_dump() for rung in estimated.rungs],
        "ours": disagreement(logs_of(estimated), shift),
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
        f"`python -m bench.calibration.light.response --write`: {result['seeds']} seeds a curve, medians. "
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
    lines += [
        "",
        "| wide bracket, stops | rig | rig, half a step | shapes | "
        + " | ".join(f"OpenCV {peer} | half a step" for peer in PEERS)
        + " |",
        "|" + "---|" * (4 + 2 * len(PEERS)),
    ]
    for row in result["wide"]:
        shapes = ", ".join(f"{row['rungs'].count(shape)} x {shape}" for shape in sorted(set(row["rungs"])))
        theirs = [row[key] for peer in PEERS for key in (peer, f"{peer} half")]
        peers = " | ".join(f"{100 * np.median(value):.1f}" for value in theirs)
        lines.append(
            f"| {row['stops']} | {100 * np.median(row['ours']):.2f} | {100 * np.median(row['half']):.2f} | "
            f"{shapes} | {peers} |"
        )
    lines += ["", "| one label of four wrong | curve, worst | other exposures | that one | named |"]
    lines.append("|---|---|---|---|---|")
    for row in result["mislabelled"]:
        values = " | ".join(f"{100 * max(row[key]):.2f}" for key in ("ours", "others", "wrong"))
        lines.append(f"| {row['curve']} | {values} | {sum(row['named'])} of {len(row['named'])} |")
    if "memorial" in result:
        lines += ["", "| real bracket | rig | " + " | ".join(f"OpenCV {peer}" for peer in PEERS) + " |"]
        lines.append("|" + "---|" * (2 + len(PEERS)))
        for name, unit in (("memorial", "stops from the authors' map"), ("t2i", "% between exposures")):
            row = result[name]
            values = " | ".join(f"{row[key]:.3g}" for key in ("ours", *PEERS))
            lines.append(f"| {name}, {unit} | {values} |")
        readable = 100 * result["memorial"]["readable"]
        lines += [
            "",
            f"memorial: {result['memorial']['evidence']}; {readable:.0f} % of the authors' map is readable.",
        ]
        lines += [f"t2i: {result['t2i']['evidence']}."]
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    seeds = range(1 if options.quick else 6)
    jitters = (0.0,) if options.quick else (0.0, JITTER)
    families = [family(name, seeds, jitter) for jitter in jitters for name in FAMILIES]
    result: dict[str, Any] = {"machine": machine(), "seeds": len(seeds), "families": families}
    result["wide"] = [wide(stops, seeds) for stops in WIDE]
    result["mislabelled"] = [mislabelled(name, 0) for name in (["gamma 2.2"] if options.quick else FAMILIES)]
    data = os.environ.get("RIG_DATA")
    if data:
        result |= {"memorial": church(Path(data) / "memorial"), "t2i": room(Path(data) / "t2i")}
    deliver(options, "response", result, table(result))


if __name__ == "__main__":
    main()
