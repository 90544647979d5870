"""Coverage of the 95 % intervals that a calibration states, over simulated flights and walks.

    python -m bench.calibration.coverage [--json] [--write] [--seeds N]

Tracks without pictures (bench.calibration.tracks): places with 0.3 px of noise, 3 % of them wrong by up to
20 px. The focal length of the files is off as files are, by 3 % in a standard deviation. The scene is
adjusted, cut, its focal length settled, its lens chosen and its errors stated as `rig calibrate` does it; the
scale is that of GPS positions with 1 m of noise. An interval is 1.96 standard errors about what was found:
for poses along the worst axis of each view, whose error is the one that is stated, in degrees and in place.
"""

import math
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from bench.calibration import tracks
from bench.support.record import arguments, deliver
from calib.adjustment.bundle_adjustment import Free, adjust, drop_outliers, misses
from calib.adjustment.jacobian import linearise
from calib.adjustment.lens_ladder import climb
from calib.adjustment.uncertainty import centre_of, drawn_moves, drawn_poses, standard_errors
from calib.poses.focal import focal_priors, settle_focal
from calib.sensor.focal_length import FocalLength
from calib.survey import similarity
from imaging.arrays import Array
from imaging.progress import unreported
from imaging.session.view_id import ViewId

SEEDS = 20
SPREAD = 0.03
"""Spread of the focal length in files."""
RECEIVER = 1.0
"""m, of GPS."""
WITHIN = 1.96
WHAT = ("focal length", "turn", "place", "scale")


def inside(kind: str, radial: tuple[float, ...], seed: int) -> dict[str, list[float]]:
    """Errors of everything in one scene over the stated standard errors."""
    rng = np.random.default_rng((5, seed))
    truth = tracks.truth(kind, seed, radial)
    model = tracks.noisy(truth, seed)
    prior = FocalLength(tracks.FOCAL * math.exp(rng.normal(0, SPREAD)), SPREAD, "the files' focal length")
    model.cameras[1].params = [prior.px, tracks.WIDTH / 2, tracks.HEIGHT / 2, 0.0]
    free, scale = Free(focal=focal_priors({1: prior})), 1.0
    for _ in range(4):
        adjust(model, free, scale, 1)
        scale = drop_outliers(model, least=0.6)
    free, _ = settle_focal(model, free, scale, 1, {1: "made"}, {"made": prior})
    scale = misses(model).typical
    free, _ = climb(model, free, scale, 1, unreported)
    adjust(model, free, scale, 1)
    stated = standard_errors(model, free, scale, unreported)
    assert stated is not None
    focal = model.cameras[1].mean_focal_length() - tracks.FOCAL
    ratios: dict[str, list[float]] = {name: [] for name in WHAT}
    ratios["focal length"] = [abs(focal) / stated.lenses["made"]["fx"]]
    poses, true = _poses(model), _poses(truth)
    linear = linearise(model, free)
    turns, shifts = drawn_poses(model, linear, drawn_moves(linear, model, free, scale))
    for view, pose in _aligned(true, poses).items():
        turn = cv2.Rodrigues(pose[:3, :3] @ poses[view][:3, :3].T)[0].ravel()
        ratios["turn"].append(float(np.degrees(abs(turn @ _worst(turns[view])))) / stated.rotation[view])
        shift = centre_of(pose) - centre_of(poses[view])
        ratios["place"].append(abs(float(shift @ _worst(shifts[view]))) / stated.translation[view])
    here = np.array([centre_of(pose) for pose in poses.values()])
    there = np.array([centre_of(true[view]) for view in poses]) + rng.normal(0, RECEIVER, (len(here), 3))
    noise = np.full(len(here), 1e-3)
    fitted, fits, scatter = similarity.consensus(here, there, noise)
    errors = similarity.standard_errors(
        there[fits], fitted(here[fits]) - there[fits], np.hypot(noise[fits], scatter)
    )
    # What the model's unit is in truth: that of its own similarity to the true places.
    unit = similarity.fit(here, np.array([centre_of(true[view]) for view in poses])).scale
    ratios["scale"] = [abs(fitted.scale / unit - 1) / errors[0]]
    return ratios


def _worst(vectors: list[Array]) -> Array:
    """Return the axis [3] along which vectors are longest, whose standard error is stated."""
    return np.asarray(np.linalg.svd(np.stack(vectors), full_matrices=False)[2][0])


def _poses(model: Any) -> dict[ViewId, Array]:
    return {
        ViewId.of_image(model.image(index).name): np.vstack(
            [model.image(index).cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]]
        )
        for index in sorted(model.reg_image_ids())
    }


def _aligned(poses: Mapping[ViewId, Array], to: Mapping[ViewId, Array]) -> dict[ViewId, Array]:
    """The poses in the world of others: turned by all turns together, scaled and moved by all places."""
    relative = np.sum([to[view][:3, :3].T @ poses[view][:3, :3] for view in poses], axis=0)
    u, _, vt = np.linalg.svd(relative)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    here = np.array([turn @ centre_of(pose) for pose in poses.values()])
    there = np.array([centre_of(to[view]) for view in poses])
    spread = here - here.mean(0)
    scale = float((spread * (there - there.mean(0))).sum() / (spread**2).sum())
    aligned = {}
    for view, place in zip(poses, scale * spread + there.mean(0), strict=True):
        pose = np.eye(4)
        pose[:3, :3] = poses[view][:3, :3] @ turn.T
        pose[:3, 3] = -pose[:3, :3] @ place
        aligned[view] = pose
    return aligned


def measure(seeds: int) -> dict[str, dict[str, float]]:
    """Shares of intervals that hold the truth, by scene and by what is stated."""
    result = {}
    for kind in tracks.KINDS:
        for lens, radial in tracks.LENSES.items():
            every = [inside(kind, radial, seed) for seed in range(seeds)]
            result[f"{kind}, {lens} lens"] = {
                name: float(np.mean([one <= WITHIN for ratios in every for one in ratios[name]]))
                for name in WHAT
            }
    result["all"] = {name: float(np.mean([row[name] for row in result.values()])) for name in WHAT}
    return result


def table(result: dict[str, dict[str, float]], seeds: int) -> str:
    lines = [
        "# The truth within the stated 95 % intervals",
        "",
        f"`python -m bench.calibration.coverage --seeds {seeds} --write`. {seeds} scenes a row, no pictures: "
        f"{tracks.NOISE:g} px of noise, {100 * tracks.WRONG:g} % of places wrong; the files' focal length is "
        f"off by {100 * SPREAD:g} % in a standard deviation, GPS by {RECEIVER:g} m. Per cent of intervals "
        "that hold the truth; turns and places along the worst axis of each view, whose standard error is "
        "what is stated.",
        "",
        f"| scenes | {' | '.join(WHAT)} |",
        "|---|" + "---|" * len(WHAT),
    ]
    for scenes, row in result.items():
        lines.append(f"| {scenes} | {' | '.join(f'{100 * row[name]:.0f}' for name in WHAT)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    options = parser.parse_args()
    result = measure(options.seeds)
    deliver(options, "coverage", result, table(result, options.seeds))


if __name__ == "__main__":
    main()
