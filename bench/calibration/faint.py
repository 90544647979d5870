"""Poses where a photosite's signal is hardly above its noise, and which part of their errors is whose.

    python -m bench.calibration.faint [--quick] [--json] [--write]

The demo rig, 24 views of 320x240, 8 stops below its usual light. A board that is shot in usual light into
the same session gives the lenses and the rig. From the model without it, two more are made by what is true:
with the true lenses; and from the true lenses, rig and poses, with each feature as far beside its point as it
is, but in a random direction, so that what errors have in common is gone. Sessions stay in --work, and are
shot once. --quick: nothing but the models without a board.
"""

from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from bench.calibration import scene
from bench.calibration.pose_error import auc, found_poses, pairs, true_poses
from bench.support.record import arguments, deliver, machine, words
from calib.adjustment.bundle_adjustment import Free, adjust, misses
from calib.poses.rigs.known_rig import camera_of
from calib.poses.sfm import fields_of
from capture.simulated import capture_simulated
from drivers.sim.rigs import simulate
from imaging.arrays import Array
from imaging.choices import Subject
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens, LensModel
from imaging.session.session import Session
from imaging.session.view_id import ViewId

FIRST_SEED = 100
"""Seed of the first rig, as in bench/calibration/poses.py."""
FAINT = 2.0**-8
"""Light, of the usual."""
WIDTH, HEIGHT = 320, 240
DRAWS = 3
"""Draws of the random directions."""


def shot(folder: Path, seed: int, kind: Subject, light: float) -> None:
    """Shoot all of a kind into a session, unless it is there."""
    if (folder / "session.json").exists() and Session.open(folder).shots(kind):
        return
    with mock.patch("capture.simulated.simulate", partial(simulate, light=light, width=WIDTH, height=HEIGHT)):
        capture_simulated("demo", folder, seed=seed, kind=kind)


def row_of(estimated: dict[ViewId, Array], true: dict[ViewId, Array], lenses: dict[str, Lens],
           focal: dict[str, float]) -> dict[str, Any]:  # fmt: skip
    """Errors of poses and of focal lengths."""
    errors = pairs(estimated, true)
    placed = errors[np.isfinite(errors[:, 0])]
    return {
        "placed": len(estimated),
        "views": len(true),
        **{f"auc_{threshold}": auc(errors, threshold) for threshold in (1, 3, 5)},
        "rotation": float(np.median(placed[:, 0])),
        "direction": float(np.median(placed[:, 1])),
        "focal": float(np.mean([100 * (focal[name] / lenses[name].fx - 1) for name in focal])),
    }


def calibrated(folder: Path, lenses: dict[str, Lens]) -> dict[str, Any]:
    """A row of what `rig calibrate` makes of a session."""
    record, seconds = scene.timed(folder)
    focal = {camera.name: camera.lens.fx for camera in record.cameras if camera.lens is not None}
    return row_of(found_poses(record), true_poses(folder), lenses, focal) | seconds


def model_of(folder: Path) -> Any:
    """The calibrated model of a session."""
    return pycolmap.Reconstruction(str(folder / "calibration" / "colmap"))


def row_of_model(model: Any, folder: Path, lenses: dict[str, Lens]) -> dict[str, Any]:
    """A row of a model, and its median residual, px."""
    fields = fields_of(model)
    poses = {view: pose.matrix() for view, pose in fields["poses"].items()}
    focal = {name: lens.fx for name, lens in fields["lenses"].items()}
    return row_of(poses, true_poses(folder), lenses, focal) | {"residual": misses(model).typical}


def names_of(model: Any) -> dict[int, str]:
    """Names of a model's cameras by COLMAP's number."""
    return {image.camera_id: ViewId.of_image(image.name).camera for image in model.images.values()}


def with_true_lenses(model: Any, lenses: dict[str, Lens]) -> Any:
    """A copy of the model with the true lenses."""
    model = pycolmap.Reconstruction(model)
    for number, name in names_of(model).items():
        exact = camera_of(lenses[name])
        model.cameras[number].model, model.cameras[number].params = exact.model, exact.params
    return model


def adjusted_to_lenses(model: Any, lenses: dict[str, Lens]) -> Any:
    """The model adjusted, with the true lenses held."""
    scale = misses(model).typical
    model = with_true_lenses(model, lenses)
    adjust(model, Free("OPENCV", fixed=frozenset(model.cameras)), scale, 1)
    return model


def at_truth(model: Any, lenses: dict[str, Lens], true: dict[ViewId, Array]) -> Any:
    """A copy of the model with the true lenses, rig and poses, and points adjusted to its features."""
    scale = misses(model).typical
    model = with_true_lenses(model, lenses)
    names = names_of(model)
    frame = next(iter({view.frame for view in true}))
    for rig in model.rigs.values():
        base = names[rig.ref_sensor_id.id]
        for sensor in rig.non_ref_sensors:
            motion = true[ViewId(frame, names[sensor.id])] @ np.linalg.inv(true[ViewId(frame, base)])
            rig.set_sensor_from_rig(sensor, pycolmap.Rigid3d(motion[:3]))
        for each in (each for each in model.frames.values() if each.rig_id == rig.rig_id):
            number = ViewId.of_image(model.images[next(iter(each.data_ids)).id].name).frame
            each.rig_from_world = pycolmap.Rigid3d(true[ViewId(number, base)][:3])
    rays = {
        index: model.cameras[image.camera_id].cam_from_img(np.array([point.xy for point in image.points2D]))
        for index, image in model.images.items()
    }
    motions = {index: image.cam_from_world().matrix() for index, image in model.images.items()}
    for point in model.points3D.values():
        rows = []
        for element in point.track.elements:
            (x, y), motion = rays[element.image_id][element.point2D_idx], motions[element.image_id]
            rows += [x * motion[2] - motion[0], y * motion[2] - motion[1]]
        place = np.linalg.svd(np.array(rows))[2][-1]
        point.xyz = place[:3] / place[3]
    adjust(model, Free("OPENCV"), scale, 1, points_only=True)
    return model


def turned(exact: Any, terms: LensModel, seed: int) -> Any:
    """A model adjusted from a true one, whose features miss by as much as they do, in random directions.

    terms: model of the lenses, which are free.
    """
    model, random = pycolmap.Reconstruction(exact), np.random.default_rng(seed)
    for image in model.images.values():
        motion, camera = image.cam_from_world().matrix(), model.cameras[image.camera_id]
        for index in range(image.num_points2D()):
            feature = image.point2D(index)
            if feature.has_point3D():
                inside = motion[:, :3] @ model.points3D[feature.point3D_id].xyz + motion[:, 3]
                projected = camera.img_from_cam(inside[None])[0]
                x, y = feature.xy - projected
                cosine, sine = np.cos(angle := random.uniform(0.0, 2 * np.pi)), np.sin(angle)
                feature.xy = projected + np.array([cosine * x - sine * y, sine * x + cosine * y])
    adjust(model, Free(terms), misses(model).typical, 1)
    return model


def rows_of(work: Path, seed: int, *, board: bool) -> dict[str, Any]:
    """All rows of one rig."""
    rig = simulate("demo", seed, width=WIDTH, height=HEIGHT)
    lenses = {mount.name: mount.optics.lens for mount in rig.mounts}
    plain = work / f"faint-{seed}"
    shot(plain, seed, "scene", FAINT)
    rows = {"as it is": [calibrated(plain, lenses)]}
    model = model_of(plain)
    rows["true lenses held"] = [row_of_model(adjusted_to_lenses(model, lenses), plain, lenses)]
    terms = next(iter(model.cameras.values())).model_name
    exact = at_truth(model, lenses, true_poses(plain))
    rows["residuals turned at random"] = [
        row_of_model(turned(exact, terms, draw), plain, lenses) for draw in range(DRAWS)
    ]
    if board:
        lit = work / f"faint-board-{seed}"
        shot(lit, seed, "scene", FAINT)
        shot(lit, seed, "board", 1.0)
        rows["with a board shot in usual light"] = [calibrated(lit, lenses)]
    return rows


def table(result: dict[str, Any]) -> str:
    """Write the rows of all rigs, by model."""
    lines = [
        "# Poses near the noise",
        "",
        f"`python -m bench.calibration.faint --write`. {words(result['machine'])}.",
        "",
        f"The demo rig, 24 views of {WIDTH}x{HEIGHT}, 8 stops below its usual light; rigs: "
        f"{len(result['rigs'])}. Of several models the median, and the lowest AUC@1. Focal length: "
        "error, mean of the cameras.",
        "",
        "| model | models | placed | AUC@1 | AUC@3 | AUC@5 | rotation, degrees | direction, degrees "
        "| focal length, % |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in result["rigs"][0]:
        rows = [row for rig in result["rigs"] for row in rig[name]]
        cells = [name, str(len(rows)), f"{min(r['placed'] for r in rows)} of {rows[0]['views']}"]
        cells.append(f"{np.median([r['auc_1'] for r in rows]):.3f} ({min(r['auc_1'] for r in rows):.3f})")
        cells += [f"{np.median([row[key] for row in rows]):.3f}" for key in ("auc_3", "auc_5")]
        cells += [f"{np.median([row[key] for row in rows]):.3f}" for key in ("rotation", "direction")]
        cells.append(f"{np.median([row['focal'] for row in rows]):+.1f}")
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__, seeds=1).parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + options.seeds)
    result = {
        "machine": machine(),
        "rigs": [rows_of(options.work, seed, board=not options.quick) for seed in seeds],
    }
    deliver(options, "faint", result, table(result))


if __name__ == "__main__":
    main()
