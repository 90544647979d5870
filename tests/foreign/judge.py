"""Judgement of rig's results on foreign photographs against their light: numpy alone, on files alone."""

import json
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from imaging.arrays import Array, Array32, Mask
from imaging.files.exr.reading import read_exr
from imaging.files.exr.writing import write_exr

from . import truth
from .folder import Shots, s_curve

Figures = dict[str, float]


def tell_truth(session: Path, light: Array32, poses: Array, shots: Shots, *, developed: bool = False) -> None:
    """Write `truth/` of an imported session, as `rig evaluate` reads it."""
    files = _files(session)
    names = {frame: Path(file).stem.rsplit("_", 1)[0] for file, frame in files.values()}
    frames = []
    for frame, name in sorted(names.items()):
        write_exr(session / "truth" / f"{frame:04d}" / f"{name}.exr", light[frame])
        x, y, z, w = Rotation.from_matrix(poses[frame, :3, :3]).as_quat(canonical=True).tolist()
        pose = {"quaternion": [w, x, y, z], "translation": poses[frame, :3, 3].tolist()}
        frames.append({"frame": frame, "cam_from_world": {name: pose}})
    exposures = [
        {
            "file": file,
            "camera": names[frame],
            "frame": frame,
            "applied": {"time": shots.seconds[source], "f_number": 8.0, "iso": 100.0},
        }
        for source, (file, frame) in files.items()
    ]
    response = None
    if developed:
        signal = np.linspace(0, 1, 4096)[1:-1]
        codes = np.arange(1, 255) / 255
        logs = np.log(np.interp(codes, s_curve(signal), signal)).tolist()
        response = {"codes": codes.tolist(), "log_exposure": [logs] * 3}
    record = {
        "schema_version": 1,
        "frames": frames,
        "cameras": {},
        "exposures": exposures,
        "response": response,
    }
    (session / "truth" / "truth.json").write_text(json.dumps(record))


def pose_figures(session: Path, poses: Array, focal: float) -> Figures:
    """Views placed and wrong, degrees of turn in the median and at worst, AUC@1, focal length off by a share.

    AUC@1: of the relative poses of all pairs, of a pair the larger error of turn and direction (Jin et al.,
    "Image Matching across Wide Baselines", 2021); views without a pose count as wrong.
    """
    record = json.loads((session / "calibration" / "calibration.json").read_text())
    estimated = {}
    for view in record["views"]:
        pose, place = view["cam_from_world"], np.eye(4)
        place[:3, :3] = Rotation.from_quat(np.roll(pose["quaternion"], -1)).as_matrix()
        place[:3, 3] = pose["translation"]
        estimated[view["frame"]] = place
    errors = truth.errors(estimated, poses)
    turns = [errors.turn[view] for view in errors.turn if view not in errors.wrong]
    areas = []
    for one, other in combinations(range(len(poses)), 2):
        worst = np.inf
        if one in estimated and other in estimated:
            relative = estimated[one] @ np.linalg.inv(estimated[other])
            true = poses[one] @ np.linalg.inv(poses[other])
            turn = np.degrees(Rotation.from_matrix(relative[:3, :3] @ true[:3, :3].T).magnitude())
            cross = np.linalg.norm(np.cross(relative[:3, 3], true[:3, 3]))
            worst = max(turn, np.degrees(np.arctan2(cross, relative[:3, 3] @ true[:3, 3])))
        areas.append(max(0.0, 1 - worst))
    lens = record["cameras"][0]["lens"]
    return {
        "placed": len(estimated),
        "wrong": len(errors.wrong),
        "degrees": float(np.median(turns)) if turns else np.nan,
        "degrees_worst": max(turns, default=np.nan),
        "auc": float(np.mean(areas)),
        "focal": lens["fx"] / focal - 1 if lens else np.nan,
    }


def exposure_figures(session: Path, shots: Shots) -> Figures:
    """Ratios of the shots of a bracket to its longest against the truth: of the labels, and as calibrated.

    In the median and at worst, relative; of single shots a view, ratios to the median of all.
    """
    files = _files(session)
    scales = json.loads((session / "calibration" / "calibration.json").read_text())["exposure_scale"]
    groups: dict[int, list[str]] = {}
    for source, (_, frame) in files.items():
        groups.setdefault(frame, []).append(source)
    if all(len(group) == 1 for group in groups.values()):
        groups = {0: list(files)}
    errors, labelled = [], []
    for group in groups.values():
        longest = max(group, key=lambda source: shots.seconds[source])
        true = np.array([shots.seconds[source] / shots.seconds[longest] for source in group])
        label = np.array([shots.labels[source] / shots.labels[longest] for source in group]) / true
        ratios = np.array([scales[files[source][0]] / scales[files[longest][0]] for source in group]) / true
        others = np.array([source != longest for source in group])
        if len(groups) == 1:
            label, ratios = label / np.median(label), ratios / np.median(ratios)
        errors += np.abs(ratios[others] - 1).tolist()
        labelled += np.abs(label[others] - 1).tolist()
    return {
        "ratios": float(np.median(errors)),
        "ratios_worst": max(errors),
        "ratios_labelled": float(np.median(labelled)),
    }


def merge_figures(merged: Path, light: Array32) -> Figures:
    """Merged brackets against the light: mu-law PSNR, stops in the median, chi-square of sigma.

    chi-square: mean over what is neither clipped nor interpolated from what is, of the squared error over
    the variance that the file states, errors beyond 10 sigma counted as 10; `_median` likewise, over 0.455,
    that of a true chi-square. Smooth parts: where the light differs by less than 10 % from its neighbours.
    """
    ours, sigmas, true = [], [], []
    for path in sorted(merged.glob("*/*.exr")):
        image = read_exr(path)
        ours.append(np.stack([image.channels[name] for name in "RGB"], -1))
        if "sigma.R" in image.channels:
            sigmas.append(np.stack([image.channels[f"sigma.{name}"] for name in "RGB"], -1))
        true.append(light[int(path.parent.name)])
    here, there = np.stack(ours), np.stack(true)
    scale = aligning(here, there)
    figures = {
        "merge_psnr": psnr(here * scale, there, float(there.max())),
        "merge_stops": float(np.median(stops(here * scale, there))),
    }
    if sigmas:
        sigma = np.stack(sigmas) * scale
        known = np.isfinite(sigma) & (sigma > 0)
        apart = np.where(known, np.clip((here * scale - there) / np.where(known, sigma, 1), -10, 10), np.nan)
        smooth = _smooth(there) & known
        figures |= {
            "chi": float(np.nanmean(apart**2)),
            "chi_smooth": float(np.mean(apart[smooth] ** 2)),
            "chi_smooth_median": float(np.median(apart[smooth] ** 2) / 0.455),
        }
    return figures


def light_figures(reconstruction: Path, light: Array32, parts: Mapping[str, Mask] | None = None) -> Figures:
    """Held-out renders against the light, brought to one scale by the median ratio.

    PSNR in the mu-law of the brightest, and of the 99.9th percentile; stops in the median, of the darkest
    tenth and of the brightest 1 %, and of parts of the pictures [V, H, W] by name.
    """
    ours, frames = [], []
    for path in sorted((reconstruction / "renders").glob("*.exr")):
        ours.append(read_exr(path).rgb())
        frames.append(int(path.stem[:4]))
    here, there = np.stack(ours), light[frames]
    here = here * aligning(here, there)
    peak, off, bright = float(there.max()), stops(here, there), there.mean(-1)
    top = float(np.percentile(there, 99.9))
    figures = {
        "psnr": float(np.mean([psnr(a, b, peak) for a, b in zip(here, there, strict=True)])),
        "psnr_999": float(np.mean([psnr(a, b, top) for a, b in zip(here, there, strict=True)])),
        "stops": float(np.median(off)),
        "stops_dark": float(np.median(off[bright <= np.percentile(bright, 10)])),
        "stops_bright": float(np.median(off[bright >= np.percentile(bright, 99)])),
    }
    for name, where in (parts or {}).items():
        pixels = off[where[frames]]
        if len(pixels) >= 50:
            figures[f"stops_{name}"] = float(np.median(pixels))
    return figures


def response_figure(session: Path) -> float:
    """RMS distance, 0..1, of the calibrated response from the true curve, at its best exposure."""
    record = json.loads((session / "calibration" / "calibration.json").read_text())
    response = record["cameras"][0]["response"]
    codes = np.array(response["codes"])
    inside = (codes > 0.02) & (codes < 0.98)

    def rms(shift: float) -> float:
        signal = np.exp(np.array(response["log_exposure"])[:, inside] + shift)
        return float(np.sqrt(np.mean((s_curve(np.clip(signal, 0, 1)) - codes[inside]) ** 2)))

    signal = np.linspace(0, 1, 4096)
    start = float(np.log(np.interp(0.5, s_curve(signal), signal)))
    start -= float(np.interp(0.5, codes, response["log_exposure"][1]))
    return min(rms(start + shift) for shift in np.linspace(-0.3, 0.3, 601))


def psnr(prediction: npt.ArrayLike, goal: npt.ArrayLike, peak: float) -> float:
    """PSNR of the mu-law (mu 5000) of both over the peak, dB."""
    a, b = (np.asarray(side, np.float64) / peak for side in (prediction, goal))
    a, b = (np.sign(side) * np.log1p(5000 * np.abs(side)) / np.log1p(5000) for side in (a, b))
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


def aligning(prediction: npt.ArrayLike, goal: npt.ArrayLike) -> float:
    """The factor on the prediction that makes the median ratio one."""
    a, b = np.asarray(prediction, np.float64), np.asarray(goal, np.float64)
    lit = (a > 0) & (b > 0)
    return float(np.exp(np.median(np.log(b[lit] / a[lit]))))


def stops(prediction: npt.ArrayLike, goal: npt.ArrayLike) -> Array:
    """|log2| of their ratio, of each value; 32 where one of them is dark."""
    a, b = np.asarray(prediction, np.float64), np.asarray(goal, np.float64)
    lit = (a > 0) & (b > 0)
    return np.where(lit, np.abs(np.log2(np.where(lit, a, 1) / np.where(lit, b, 1))), 32.0)


def _smooth(light: Array32) -> Mask:
    """Values [V, H, W, C] that differ by less than 10 % from those above, below, left and right."""
    smooth = np.zeros(light.shape, bool)
    inner = light[:, 2:-2, 2:-2]
    near = [light[:, 2 + down : light.shape[1] - 2 + down, 2 + right : light.shape[2] - 2 + right]
            for down in (-2, -1, 0, 1, 2) for right in (-2, -1, 0, 1, 2)]  # fmt: skip
    flat = np.max([np.abs(side - inner).max(-1) for side in near], axis=0) < 0.1 * inner.min(-1)
    smooth[:, 2:-2, 2:-2] = flat[..., None]
    return smooth


def _files(session: Path) -> dict[str, tuple[str, int]]:
    """The session's file and the frame of each original, by its name."""
    shots: list[dict[str, Any]] = [
        json.loads(line) for line in (session / "shots.jsonl").read_text().splitlines()
    ]
    return {Path(shot["source"]).name: (shot["file"], shot["frame"]) for shot in shots}
