"""Small sets of photographs that hardly a choice was made on, by rig and by pycolmap's defaults.

    python -m bench.real.poses.untouched FOLDER [--quick] [--json] [--write] [--work FOLDER] [--sets ET,...]

FOLDER holds a folder of photographs for each set: ET and kermit (examples/ of snavely/bundler_sfm, 640 px),
crazyhorse (dataset/ of royshil/SfM-Toy-Library), sacre_coeur (datasets/sacre_coeur/mapping of
cvg/Hierarchical-Localization, ten tourists' cameras without EXIF) and NLE_tower (assets/ of naver/mast3r, a
telephone, far apart), all on GitHub. Three choices were made after a look at these: that
single photographs are compared through their exposures and how far drawn lenses go (ET, sacre_coeur), and
when further features are looked for (kermit). No set has true poses: turns of both programs are
compared, pair by pair. Drafts of rig are trained on its own poses. --quick: ET.
"""

import argparse
import shutil
from collections.abc import Mapping
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.own_process import row_of
from bench.support.plain_pycolmap import place
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.spent import processor_seconds
from bench.support.trial import Cache
from calib.calibrate import calibrate
from capture.imports.photos import import_photos
from imaging.arrays import Array
from imaging.errors import RigError
from imaging.session.session import Session
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct

SETS = "ET", "kermit", "crazyhorse", "sacre_coeur", "NLE_tower"
PHOTOGRAPHS = ".jpg", ".jpeg", ".png"


def by_rig(folder: Path, work: Path) -> dict[str, Any]:
    """Import, calibrate and train a draft of a set as the command line does."""
    session = work / f"untouched-{folder.name}"
    shutil.rmtree(session, ignore_errors=True)
    import_photos(folder, session)
    began = processor_seconds()
    try:
        record = calibrate(session)
    except RigError as error:
        return {"turns": {}, "focal": {}, "seconds": processor_seconds() - began, "doubts": [str(error)]}
    row: dict[str, Any] = {"seconds": processor_seconds() - began, "doubts": list(record.doubts)}
    shots = Session.open(session).shots("scene")
    names = {(shot.frame, shot.camera): Path(shot.source or shot.file).name for shot in shots}
    lenses = {camera.name: camera.lens for camera in record.cameras}
    row["turns"] = {
        names[view.frame, view.camera]: view.cam_from_world.matrix()[:3, :3].tolist() for view in record.views
    }
    row["focal"] = {
        names[view.frame, view.camera]: lens.fx / max(lens.width, lens.height)
        for view in record.views
        if (lens := lenses[view.camera]) is not None
    }
    scene = reconstruct(session, TrainingRequest(quality="draft", replace=True))
    metrics = evaluate(scene)
    return row | {"db": metrics.ldr_psnr_oe, "ssim": metrics.ssim}


def by_pycolmap(folder: Path, work: Path) -> dict[str, Any]:
    """Place a set by pycolmap's defaults, which sort photographs into cameras by EXIF and size."""
    names = sorted(path.name for path in folder.iterdir() if path.suffix.lower() in PHOTOGRAPHS)
    best, seconds = place(folder, work / f"untouched-{folder.name}-pycolmap", names)
    images = [] if best is None else [best.image(number) for number in best.reg_image_ids()]
    return {
        "seconds": seconds,
        "turns": {image.name: image.cam_from_world().matrix()[:3, :3].tolist() for image in images},
        "focal": {
            image.name: image.camera.mean_focal_length() / max(image.camera.width, image.camera.height)
            for image in images
        },
    }


PROGRAMS = {"rig": by_rig, "pycolmap": by_pycolmap}


def differences(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> list[float]:
    """Angles by which the turn between two views differs, degrees, of all pairs that both have placed."""
    angles = []
    for one, other in combinations(sorted(ours.keys() & theirs.keys()), 2):
        between: list[Array] = [np.array(of[one]) @ np.array(of[other]).T for of in (ours, theirs)]
        cosine = (np.trace(between[0] @ between[1].T) - 1) / 2
        angles.append(float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))))
    return angles


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set."""
    alone = partial(row_of, "bench.real.poses.untouched")
    cache, rows = Cache(options.work / "untouched.jsonl"), {}
    for name in options.sets:
        folder = options.folder / name
        views = sum(path.suffix.lower() in PHOTOGRAPHS for path in folder.iterdir())
        row: dict[str, Any] = {
            program: cache.get(f"{name} {program}", partial(alone, program, folder, options.work))
            for program in PROGRAMS
        }
        rows[name] = row | {"views": views}
    return {"machine": machine(), "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown."""
    lines = [
        "# Small sets of photographs",
        "",
        f"`python -m bench.real.poses.untouched FOLDER --write`. {words(result['machine'])}. "
        "Processor seconds.",
        "",
        "Turns: by how much those between two views differ between the programs, median and largest, "
        "degrees. Focal length: the median of rig's over pycolmap's, and the farthest from 1. Draft: of rig, "
        "dB and SSIM of held-out photographs.",
        "",
        "| set | views | placed by rig | by pycolmap | turns | focal length | s | pycolmap, s | draft |",
        "|" + "---|" * 9,
    ]
    for name, row in result["rows"].items():
        ours, theirs = row["rig"], row["pycolmap"]
        angles = differences(ours["turns"], theirs["turns"])
        both = ours["focal"].keys() & theirs["focal"].keys()
        ratios = np.array([ours["focal"][view] / theirs["focal"][view] for view in sorted(both)])
        cells = ["", ""]
        if angles:
            farthest = ratios[np.argmax(np.abs(np.log(ratios)))]
            cells = [
                f"{np.median(angles):.2f}, {max(angles):.2f}",
                f"{np.median(ratios):.3f}, {farthest:.3f}",
            ]
        draft = f"{ours['db']:.1f}, {ours['ssim']:.2f}" if ours.get("db") else ""
        placed = [len(one["turns"]) for one in (ours, theirs)]
        seconds = [f"{one['seconds']:.0f}" for one in (ours, theirs)]
        lines.append(f"| {' | '.join(map(str, [name, row['views'], *placed, *cells, *seconds, draft]))} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("folder", type=Path, help="a folder for each set")
    parser.add_argument(
        "--work", type=Path, default=WORK / "untouched", help="keeps sessions and finished rows"
    )
    parser.add_argument("--sets", default=",".join(SETS), help="comma-separated")
    options = parser.parse_args()
    options.sets = SETS[:1] if options.quick else tuple(options.sets.split(","))
    options.work.mkdir(parents=True, exist_ok=True)
    result = measure(options)
    deliver(options, "real_untouched", result, table(result))


if __name__ == "__main__":
    main()
