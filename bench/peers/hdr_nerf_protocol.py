"""HDR-NeRF's protocol (Huang et al., CVPR 2022): what is imported, trained and tested, as `rig` does it.

    python -m bench.peers.hdr_nerf_protocol [--quick] [--json] [--write] [--seeds 1] [--pixels 200]
        [--quality draft|standard|best] [--protocols exp-3,exp-1] [--methods vanilla,hdr-gs,nh-3dgs]
        [--scene FOLDER] [--work FOLDER]

Scenes of the simulator in that layout, or with --scene one of the data set, as it was downloaded.
Training sees every other view at t1, t3 and t5: at all three in Exp-3 (as HDR-GS has it), at one of them
in Exp-1 (as HDR-NeRF has it; here each is drawn equally often). The other views are tested at all five
exposures, t2 and t4 being new, and against the true light over its maximum. NH-3DGS sees the true light
of the training views: a bound for all that sees photographs. Finished rows are kept in FOLDER.

`rig calibrate --only response` comes before HDR-GS, and sees the photographs of the training alone: in Exp-3
their brackets, in Exp-1, where no view has two exposures, the points that views share.
"""

import argparse
import shutil
import sys
from functools import partial
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.hdr_nerf_scene import Size, curve, write_scene
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.calibrate import calibrate
from calib.request import CalibrationRequest
from capture.imports.photos import import_photos
from capture.imports.request import ImportRequest
from imaging.files import store
from imaging.session.calibration import read_calibration
from imaging.session.records import SplitRecord
from imaging.session.session import SPLIT, Session
from recon.decide.presets import MethodName
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct

METHODS = ("vanilla", "hdr-gs", "nh-3dgs")
TITLES = {"vanilla": "vanilla 3DGS", "hdr-gs": "HDR-GS", "nh-3dgs": "NH-3DGS on the true light"}
KEEP = (
    "ldr_psnr_oe", "ssim", "ldr_psnr_ne", "ssim_ne", "hdr_psnr_mu", "hdr_psnr_mu_aligned",
    "response_rmse", "alignment_scale", "train_seconds", "iterations", "gaussians", "render_fps",
)  # fmt: skip
COLUMNS = {
    "OE dB": ("ldr_psnr_oe", 2), "OE SSIM": ("ssim", 4), "NE dB": ("ldr_psnr_ne", 2),
    "NE SSIM": ("ssim_ne", 4),
    "HDR dB": ("hdr_psnr_mu", 2), "HDR dB, aligned": ("hdr_psnr_mu_aligned", 2),
    "response RMSE, %": ("response_rmse", 2), "s": ("train_seconds", 0),
}  # fmt: skip
PAPERS = (
    "| 3DGS, in the table of HDRGS (Wu et al.) | 11.24 | | | | | | | |",
    "| HDRGS (Wu et al., arXiv 2408.06543) | 39.16 | | | | | | | 408, A100 |",
    "| GaussHDR (CVPR 2025) | 42.29 | | | | 37.62 | | | |",
    "| PhysHDR-GS (CVPR 2026) | 44.26 | | 43.19 | | 39.21 | | | |",
    "| NH-3DGS (Zhang et al., arXiv 2511.12895), from HDR, 800 px | | | | | 39.77 | | | |",
)


def photographs(scene: Path, session: Path) -> Path:
    """The session of a scene's photographs, with the data set's own split."""
    if not (session / "calibration" / "calibration.json").exists():
        import_photos(scene, session, ImportRequest(layout="hdr-nerf"))
        _add_curve(session / "truth" / "truth.json")
    return session


def true_light(photos: Path, session: Path) -> Path:
    """The same views as linear EXR, from the truth of a session of photographs; the same split."""
    if (session / SPLIT).exists():
        return session
    calibration = read_calibration(photos)
    folder, frames = session.with_name(f"{session.name}-files"), []
    for view in calibration.views:
        lens = calibration.camera(view.camera).lens
        assert lens is not None
        name = f"{view.frame:04d}.exr"
        store.write_bytes(folder / name, (photos / "truth" / f"{view.id}.exr").read_bytes())
        axes = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL's
        pose = np.linalg.inv(view.cam_from_world.matrix()) @ axes
        size = {"w": lens.width, "h": lens.height}
        terms = {"fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy}
        terms |= {key: getattr(lens, key) for key in ("k1", "k2", "p1", "p2")}
        frames.append({"file_path": name, "transform_matrix": pose.tolist(), **size, **terms})
    store.write_json(folder / "transforms.json", {"frames": frames})
    import_photos(folder, session, ImportRequest(layout="nerfstudio"))
    split = _split_of(photos)
    frame_of = {shot.file: shot.frame for shot in Session.open(photos).shots()}
    train, test = ({frame_of[file] for file in files} for files in (split.train, split.test))
    number = {shot.file: int(Path(shot.source or "").stem) for shot in Session.open(session).shots()}
    _write_split(session, "the photographs",
        [file for file, frame in number.items() if frame in train],
        [file for file, frame in number.items() if frame in test],
    )  # fmt: skip
    return session


def one_exposure_each(photos: Path, session: Path, scene: Path, seed: int) -> Path:
    """A session of the photographs of which training sees each view once: t1, t3, t5 in a drawn order."""
    if not (session / "calibration" / "calibration.json").exists():
        photographs(scene, session)
    split = _split_of(photos)
    views: dict[int, list[str]] = {}
    shots = {shot.file: shot for shot in Session.open(session).shots()}
    for file in split.train:
        views.setdefault(shots[file].frame, []).append(file)
    turns = np.random.default_rng([seed, 0xE1]).permutation(np.arange(len(views)) % 3)
    chosen = [sorted(files)[turn % len(files)] for files, turn in zip(views.values(), turns, strict=True)]
    _write_split(session, "Exp-1", chosen, list(split.test))
    return session


def with_measured_response(plain: Path, session: Path) -> Path:
    """Replace the response of a session by the one from its photographs for training."""
    if not session.exists():
        with store.replacing(session) as part:
            shutil.copytree(plain, part, ignore=shutil.ignore_patterns("reconstructions"))
            calibrate(part, CalibrationRequest(only="response"))
    return session


def _split_of(session: Path) -> SplitRecord:
    split = Session.open(session).split()
    if split is None:
        raise SystemExit(f"{session} has no views for testing: name a scene of HDR-NeRF's data set.")
    return split


def _write_split(session: Path, reason: str, train: list[str], test: list[str]) -> None:
    record = SplitRecord(reason=reason, train=tuple(train), test=tuple(test))
    store.write_json(session / SPLIT, record.model_dump(mode="json"))


def _add_curve(truth: Path) -> None:
    """Rendered scenes went through one known curve; photographed ones have no truth."""
    if not truth.is_file():
        return
    logs = np.linspace(np.log(1e-6), np.log(230.0), 2000)
    codes = np.arange(1, 255) / 255
    log_exposure = np.interp(codes, curve(logs), logs).tolist()
    record = store.read_json(truth)
    record["response"] = {"codes": codes.tolist(), "log_exposure": [log_exposure] * 3}
    store.write_json(truth, record)


def row(options: argparse.Namespace, protocol: str, method: MethodName, seed: int) -> dict[str, Any] | None:
    """Train and test once; None where a scene of the data set has no true light to train on."""
    base = options.work / f"hdr-nerf-{options.name}" / str(seed)
    scene = options.scene or base / "scene"
    if options.scene is None:
        write_scene(scene, options.size, seed)
    session = photos = photographs(scene, base / "exp-3")
    if method == "nh-3dgs":
        if not (photos / "truth").is_dir():
            return None
        session = true_light(photos, base / "light")
    elif protocol == "exp-1":
        session = one_exposure_each(photos, base / "exp-1", scene, seed)
    if method == "hdr-gs":
        session = with_measured_response(session, base / f"{protocol}-measured")
    name = f"{method}-{options.quality}"
    folder = reconstruct(
        session,
        TrainingRequest(method=method, quality=options.quality, seed=seed, name=name),
        on_progress=_report,
    )
    figures = evaluate(folder).known()
    if method == "vanilla":
        figures.pop("response_rmse", None)  # of what the import assumed: it learns none
    return {key: figures[key] for key in KEEP if key in figures}


def _report(message: str, done: int, total: int) -> None:
    if done % 500 == 0:
        print(f"  {message} {done}/{total}", file=sys.stderr)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "hdr-nerf-protocol.jsonl")
    rows = []
    for seed, protocol, method in product(range(options.seeds), options.protocols, options.methods):
        if method == "nh-3dgs" and protocol != options.protocols[0]:
            continue  # it sees no exposures
        key = f"{version('hdr-rig')} {options.name} {options.quality} {protocol} {method} {seed}"
        print(key, file=sys.stderr)
        figures = cache.get(key, partial(row, options, protocol, method, seed))
        if figures is not None:
            rows.append({"seed": seed, "protocol": protocol, "method": method} | figures)
    return {"machine": machine(), "scene": options.name, "quality": options.quality, "rows": rows}


def report(result: dict[str, Any]) -> str:
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in result["rows"]:
        groups.setdefault((row["protocol"], row["method"]), []).append(row)
    seeds = len({row["seed"] for row in result["rows"]})
    lines = [
        "# HDR-NeRF's protocol",
        "",
        f"`python -m bench.peers.hdr_nerf_protocol --write`: scene {result['scene']}, quality "
        f"{result['quality']}, "
        f"means over {seeds} seed{'s' if seeds > 1 else ''}. {words(result['machine'])}.",
        "",
        "Trained on t1, t3 and t5 of every other view (Exp-3: all three; Exp-1: one each), tested on the",
        "others at those (OE) and at t2 and t4 (NE). HDR: mu-law, over the truth's maximum; aligned: after",
        "one scale. Response: calibrated from the training photographs first, in Exp-1, where no view has",
        "two exposures, on the points that views share. The papers' figures are of other scenes and stand",
        "beside ours for orientation only.",
        "",
        "| method | " + " | ".join(COLUMNS) + " |",
        "|---|" + "---|" * len(COLUMNS),
    ]
    for (protocol, method), rows in groups.items():
        cells = []
        for key, digits in COLUMNS.values():
            values = [row[key] * (100 if key == "response_rmse" else 1) for row in rows if key in row]
            cells.append(f"{np.mean(values):.{digits}f}" if values else "")
        title = TITLES[method] if method == "nh-3dgs" else f"{TITLES[method]}, {protocol.capitalize()}"
        lines.append(f"| {title} | {' | '.join(cells)} |")
    return "\n".join([*lines, *PAPERS, ""])


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--pixels", type=int, default=200)
    parser.add_argument("--quality", choices=("draft", "standard", "best"), default="standard")
    parser.add_argument("--protocols", type=lambda text: text.split(","), default=["exp-3", "exp-1"])
    parser.add_argument("--methods", type=lambda text: text.split(","), default=list(METHODS))
    parser.add_argument("--scene", type=Path)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.size = Size(options.pixels, 7, 5)
    if options.quick:
        options.size, options.quality, options.seeds = Size(64, 4, 3), "draft", 1
        options.protocols, options.methods = ["exp-3"], ["vanilla", "hdr-gs"]
    size_name = f"{options.size.pixels}px-{options.size.views}"
    options.name = options.scene.resolve().name if options.scene else size_name
    result = measure(options)
    deliver(options, "hdr_nerf_protocol", result, report(result))


if __name__ == "__main__":
    main()
