"""Hand-eye calibration of two cameras with non-overlapping views: accuracy, and refusals.

    python -m bench.calibration.apart [--quick] [--json] [--write]

Points of the walls of a hall, seen by two cameras of 640x480 back to back, 0.2 m apart or so, off by 0.2 px
(normal, each coordinate); no pictures. The rig is in a hand that walks two metres, five metres from the
walls. Motions: turns about all axes by 10 degrees (root mean square), by 3 degrees, and degenerate ones:
none, about one axis, about a point.
"""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.calibration.pose_error import covered, degrees_of
from bench.support.record import arguments, deliver
from calib.data.features import Features
from calib.poses.pose_inputs import PoseInputs
from calib.poses.sfm import SceneModel, solve
from imaging.arrays import Array
from imaging.optics.lens import Lens
from imaging.session.calibration import MOTION
from imaging.session.view_id import ViewId

WIDTH, HEIGHT, FOCAL, NOISE, POINTS = 640, 480, 620.0, 0.2, 1200
GUESS = Lens(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, fx=640.0, fy=640.0, cx=320.0, cy=240.0)
RIG = ("front", "back")
FRAMES, SEEDS, REFUSED = 12, 8, 3
MOTIONS = {"all axes, 10 degrees": 10.0, "all axes, 3 degrees": 3.0}
DEGENERATE = ("no turn", "one axis", "one point")


def hall(rng: np.random.Generator) -> tuple[Array, Array]:
    """Points of the walls ahead and behind [N, 3], m, and descriptors that no two share."""
    world = rng.uniform(-1, 1, (POINTS, 3)) * (5.0, 3.0, 1.0)
    world[:, 2] += np.where(np.arange(POINTS) % 2, 5.0, -5.0)
    return world, rng.exponential(30, (POINTS, 128))


def rigid(turn: Array, shift: Array) -> Array:
    """A pose [4, 4] of a rotation vector, degrees, and a shift."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn, degrees=True).as_matrix(), shift
    return pose


def walk(rng: np.random.Generator, motion: str) -> list[Array]:
    """front_from_world of each frame."""
    turns = MOTIONS.get(motion, 10.0) * rng.normal(size=(FRAMES, 3))
    if motion == "no turn":
        turns[:] = 0.3 * rng.normal(size=(FRAMES, 3))
    if motion == "one axis":
        turns[:, [0, 2]] = 0.3 * rng.normal(size=(FRAMES, 2))
    places = np.linspace([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], FRAMES) + 0.15 * rng.normal(size=(FRAMES, 3))
    if motion == "one point":
        arm = np.array([0.5, 0.3, 1.0])
        places = Rotation.from_rotvec(turns, degrees=True).inv().apply(arm) - arm
    poses = [rigid(turn, np.zeros(3)) for turn in turns]
    for pose, place in zip(poses, places, strict=True):
        pose[:3, 3] = -pose[:3, :3] @ place
    return poses


def features_of(scene: tuple[Array, Array], pose: Array, rng: np.random.Generator) -> Features:
    """Points and descriptors in a camera."""
    x, y, z = (scene[0] @ pose[:3, :3].T + pose[:3, 3]).T
    u, v = FOCAL * x / z + WIDTH / 2, FOCAL * y / z + HEIGHT / 2
    inside = np.flatnonzero((u > 0) & (u < WIDTH) & (v > 0) & (v < HEIGHT) & (z > 0.1))
    rng.shuffle(inside)
    points = np.stack([u, v], axis=1)[inside] + rng.normal(0, NOISE, (len(inside), 2))
    noisy = scene[1][inside] + rng.normal(0, 2, (len(inside), 128))
    return Features(points, np.clip(noisy, 0, 255).astype(np.uint8))


def trial(seed: int, motion: str) -> dict[str, Any]:
    """One walk, calibrated."""
    rng = np.random.default_rng(seed)
    scene = hall(rng)
    yaw, pitch, roll = rng.normal([180.0, 0.0, 0.0], [8.0, 4.0, 4.0])
    back_from_front = np.eye(4)
    back_from_front[:3, :3] = Rotation.from_euler("yxz", (yaw, pitch, roll), degrees=True).as_matrix()
    back_from_front[:3, 3] = rng.normal([0.0, 0.0, -0.2], 0.05)
    truth, features = {}, {}
    for frame, pose in enumerate(walk(rng, motion)):
        for name, cam_from_world in (("front", pose), ("back", back_from_front @ pose)):
            truth[ViewId(frame, name)] = cam_from_world
            features[ViewId(frame, name)] = features_of(scene, cam_from_world, rng)
    model = solve(PoseInputs(features, [RIG]), dict.fromkeys(RIG, GUESS))
    (rung,) = (rung for rung in model.rungs if rung.name == MOTION)
    row = {"motion": motion, "tied": rung.taken, "reason": rung.reason}
    return row | (errors(model, truth) if rung.taken else {})


def errors(model: SceneModel, truth: dict[ViewId, Array]) -> dict[str, Any]:
    """Errors of the rotation between the cameras, degrees, and of their shift, mm, and both over the stated
    ones.
    """
    poses = {view: pose.matrix() for view, pose in model.poses.items()}
    ours, true = (
        every[ViewId(0, "back")] @ np.linalg.inv(every[ViewId(0, "front")]) for every in (poses, truth)
    )
    metres = walked(truth) / walked(poses)
    turn = degrees_of(ours[:3, :3] @ true[:3, :3].T)
    shift = 1000 * float(np.linalg.norm(metres * ours[:3, 3] - true[:3, 3]))
    assert model.errors is not None
    ((stated_turn, stated_shift),) = model.errors.mounted.values()
    return {
        "turn": turn,
        "shift": shift,
        "turn over stated": turn / stated_turn,
        "shift over stated": shift / (1000 * metres * stated_shift),
    }


def walked(poses: dict[ViewId, Array]) -> float:
    """Return how far the front camera is from the middle of its way, root mean square."""
    eyes = np.array([-pose[:3, :3].T @ pose[:3, 3] for view, pose in poses.items() if view.camera == "front"])
    return float(np.sqrt(((eyes - eyes.mean(0)) ** 2).sum(1).mean()))


def table(rows: list[dict[str, Any]]) -> str:
    lines = [
        "# Cameras that see nothing in common",
        "",
        f"`python -m bench.calibration.apart --write`. {FRAMES} frames, walls 5 m away, points off by "
        f"{NOISE} px. In: errors within 2.8 stated standard errors of the worst axis, which holds 95 %.",
        "",
        "| motion | tied | turn, degrees: median, worst | shift, mm: median, worst | in: turn, shift |",
        "|---|---|---|---|---|",
    ]
    for motion in (*MOTIONS, *DEGENERATE):
        of_motion = [row for row in rows if row["motion"] == motion]
        tied = [row for row in of_motion if row["tied"]]
        cells = ["-"] * 3
        if tied:
            values = {name: [row[name] for row in tied] for name in ("turn", "shift")}
            cells = [
                f"{np.median(each):.{digits}f}, {max(each):.{digits}f}"
                for each, digits in zip(values.values(), (3, 1), strict=True)
            ]
            inside = [covered([row[f"{name} over stated"] for row in tied]) for name in ("turn", "shift")]
            cells.append(", ".join(f"{100 * share:.0f} %" for share in inside if share is not None))
        lines.append(f"| {motion} | {len(tied)} of {len(of_motion)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    seeds = 2 if options.quick else SEEDS
    rows = [trial(seed, motion) for motion in MOTIONS for seed in range(seeds)]
    rows += [trial(seed, motion) for motion in DEGENERATE for seed in range(min(seeds, REFUSED))]
    deliver(options, "apart", {"rows": rows}, table(rows))


if __name__ == "__main__":
    main()
