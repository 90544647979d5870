"""Poses of cameras that expose row after row while they move, calibrated as if they exposed all rows at once.

    python -m bench.calibration.rolling_shutter [--quick] [--json] [--write]

Points around the origin, seen by a camera of 640x480 from an arc of four metres, off by 0.2 px (normal, each
coordinate); no pictures. Rows are read one after another, the middle one where the truth has the camera.
Walking: 1 m/s along the arc and 20 degrees/s about any axis (root mean square); held still by hand: 0.05 m/s
in any direction and 3 degrees/s; standing: on a tripod. Errors are of all pairs of views against the truth.
"""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.calibration.pose_error import aligned, auc, covered, pairs
from bench.support.record import arguments, deliver
from calib.data.features import Features
from calib.poses.pose_inputs import PoseInputs
from calib.poses.sfm import solve
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.optics.lens import Lens
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL, NOISE, POINTS = 640, 480, 620.0, 0.2, 600
GUESS = Lens(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=640.0, fy=640.0, cx=320.0, cy=240.0)
VIEWS, STEP, FAR = 12, 8.0, 4.0
"""Number of views on the arc, degrees apart, metres from its middle."""
MOTIONS = {"standing": (0.0, 0.0, 0.0), "held still by hand": (0.0, 0.05, 3.0), "walking": (1.0, 0.1, 20.0)}
"""m/s along the arc, m/s in any direction, degrees/s about any axis."""
READOUTS = (10, 20, 30)
"""ms from the first row to the last."""
SEEDS = 4
COLUMNS = {"turn": 3, "place": 1, "auc": 3, "reprojection": 2, "points": 0, "focal": 2}
"""Columns of a row, and their digits."""


def arc(number: int) -> Array:
    """cam_from_world [4, 4] of a view; the camera walks to its right."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("y", STEP * (number - (VIEWS - 1) / 2), degrees=True).as_matrix()
    pose[:3, 3] = 0.0, 0.05 * np.sin(number), FAR
    return pose


def read(pose: Array, world: Array, shift: Array, turn: Array, readout: float) -> Array:
    """Return where the camera sees the points, px [N, 2]; nan behind it.

    shift: m/s, and turn: rad/s, of the camera in its own axes. readout: s.
    """
    local = world @ pose[:3, :3].T + pose[:3, 3]
    row = np.full(len(world), HEIGHT / 2)
    pixels = np.empty((len(world), 2))
    for _ in range(5):  # a point is seen when its row is read, which is where it is seen then
        late = readout * (row / HEIGHT - 0.5)[:, None]
        local_late = Rotation.from_rotvec(-late * turn).apply(local - late * shift)
        depth = np.where(local_late[:, 2] > 0.1, local_late[:, 2], np.nan)
        pixels = FOCAL * local_late[:, :2] / depth[:, None] + np.array([WIDTH / 2, HEIGHT / 2])
        row = np.clip(np.nan_to_num(pixels[:, 1], nan=HEIGHT / 2), 0, HEIGHT)
    return pixels


def trial(seed: int, motion: str, readout: float) -> dict[str, Any]:
    """One walk, calibrated; readout: ms."""
    rng = np.random.default_rng(seed)
    world = rng.uniform(-1, 1, (POINTS, 3)) * (1.2, 0.9, 0.7)
    descriptors = rng.exponential(30, (POINTS, 128))
    along, any_way, turning = MOTIONS[motion]
    features, truth = {}, {}
    for number in range(VIEWS):
        pose = arc(number)
        shift = np.array([along, 0.0, 0.0]) + any_way * rng.normal(size=3) / np.sqrt(3)
        turn = np.radians(turning) * rng.normal(size=3) / np.sqrt(3)
        pixels = read(pose, world, shift, turn, readout / 1000)
        inside = np.flatnonzero(((pixels > 0) & (pixels < (WIDTH, HEIGHT))).all(1))
        rng.shuffle(inside)
        noisy = np.clip(descriptors[inside] + rng.normal(0, 2, (len(inside), 128)), 0, 255)
        places = pixels[inside] + rng.normal(0, NOISE, (len(inside), 2))
        features[ViewId(number, "cam")] = Features(places, noisy.astype(np.uint8))
        truth[ViewId(number, "cam")] = pose
    row = {"motion": motion, "readout": readout}
    try:
        model = solve(PoseInputs(features), {"cam": GUESS})
    except CalibrationError as error:
        return row | {"views": 0, "reason": str(error)}
    poses = {view: pose.matrix() for view, pose in model.poses.items()}
    errors = pairs(poses, truth)
    views, turns, shifts, _ = aligned(poses, truth)
    stated = [] if model.errors is None else [model.errors.rotation[view] for view in views]
    placed = errors[np.isfinite(errors[:, 0])]
    return row | {
        "views": len(poses),
        "turn": float(np.median(placed[:, 0])),
        "place": 1000 * float(np.median(np.linalg.norm(shifts, axis=1))),
        "auc": auc(errors, 1),
        "reprojection": model.reprojection_px,
        "points": model.reconstruction.num_points3D(),
        "focal": 100 * abs(model.lenses["cam"].fx / FOCAL - 1),
        "ratios": (np.linalg.norm(turns, axis=1) / stated).tolist() if stated else [],
    }


def table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "# Rows that are read one after another",
        "",
        "`python -m bench.calibration.rolling_shutter --write`. Calibrated as if all rows were exposed at "
        f"once; {VIEWS} views of {WIDTH}x{HEIGHT}, {FAR:.0f} m away, points off by {NOISE} px. Medians over "
        f"{SEEDS} walks. In: turns within 2.8 stated standard errors, which holds 95 %.",
        "",
        "| motion | readout, ms | views | turn, degrees | place, mm | AUC@1 | reprojection, px | points "
        "| focal length, % | in |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for motion, readout in dict.fromkeys((row["motion"], row["readout"]) for row in rows):
        part = [row for row in rows if (row["motion"], row["readout"]) == (motion, readout)]
        placed = [row for row in part if row["views"]]
        middle = {
            name: float(np.median([row[name] for row in placed])) if placed else float("nan")
            for name in COLUMNS
        }
        inside = covered([ratio for row in placed for ratio in row["ratios"]])
        line = " | ".join(f"{middle[name]:.{digits}f}" for name, digits in COLUMNS.items())
        lines.append(
            f"| {motion} | {readout} | {sum(row['views'] for row in part)} of {VIEWS * len(part)} | {line} | "
            f"{'-' if inside is None else f'{100 * inside:.0f} %'} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    cases = [("standing", 0), *((motion, time) for motion in list(MOTIONS)[1:] for time in READOUTS)]
    seeds = 1 if options.quick else SEEDS
    rows = [trial(seed, motion, time) for motion, time in cases for seed in range(seeds)]
    deliver(options, "rolling_shutter", {"rows": rows}, table(rows))


if __name__ == "__main__":
    main()
