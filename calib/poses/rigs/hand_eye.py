"""Hand-eye calibration of cameras with non-overlapping views.

On a rigid rig the motion of one camera between two frames determines that of the other: R_b X = X R_a of
turns, and (R_b - 1) x + s t_b = X t_a of shifts, X and x being the place of the one in the other and s the
ratio of the units of their scenes (hand-eye calibration: Tsai and Lenz, 1989; of structure from motion, whose
scale is unknown: Andreff, Horaud and Espiau, "Robot Hand-Eye Calibration Using Structure-from-Motion", 2001;
of the cameras of a rig: Esquivel, Woelk and Koch, "Calibration of a Multi-Camera Rig from Non-overlapping
Views", 2007).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from imaging.arrays import Array
from imaging.errors import CalibrationError

FEWEST_FRAMES = 5
"""Fewest frames in which both cameras are placed. Three determine the mount; the others its error."""
LEAST_TURN = 2.0
"""Smallest rotation about an axis, degrees rms, that counts."""
LEAST_MOVE = 0.02
"""Root mean square by which a camera has to leave the places that a turn about one point explains, as a share
of the distance of what it sees."""
MOST_TURN = 0.5
"""Degrees, the largest standard error of the turn between the cameras with which they are tied."""
MOST_SHIFT = 0.02
"""The same of their shift, as a share of the distance of the scene, and of the ratio of the units."""
MOST_MISS = 1.0
"""Degrees by which frames may miss in the median; beyond, the cameras did not move as one."""
EXACT = np.radians(0.02)
"""No pose is taken to be more exact."""
_PARAMETERS = 13
_TURN_BOTH = "turn it to the sides and up and down, by 15 degrees each, while it is moved through the scene"


@dataclass(frozen=True, eq=False)
class Tie:
    """Two cameras a and b of a rig, each in a world of its own.

    b_from_a: [4, 4], in the units of a's world; turn_error, degrees, and shift_error: its standard errors,
    about and along the worst axis. a_world_from_b_world: a similarity [3, 4]; scale_error: of its scale.
    """

    b_from_a: Array
    a_world_from_b_world: Array
    turn_error: float
    shift_error: float
    scale_error: float


def tie(a: Array, b: Array, distances: tuple[float, float]) -> Tie:
    """Tie two cameras together by their poses at the same frames, cam_from_world [N, 4, 4].

    distances: of what each of them sees, in the units of its world: a shift by it counts as a turn by one
    radian. Errors: CalibrationError when the motion does not determine the tie, saying what motion does.
    """
    for poses, far in ((a, distances[0]), (b, distances[1])):
        _require_motion(poses, far)
    start = _start(a, b)
    distance = distances[0]

    def misses(parameters: Array) -> Array:
        return _misses(parameters, start, a, b, 1 / distance)

    fit = least_squares(misses, np.zeros(_PARAMETERS), loss="soft_l1", f_scale=3 * EXACT, x_scale="jac")
    residuals = fit.fun.reshape(len(a), 6)
    miss = float(np.degrees(np.median(np.linalg.norm(residuals[:, :3], axis=1))))
    if miss > MOST_MISS:
        raise CalibrationError(
            f"they did not move as one but turned by {miss:.1f} degrees against each other in the median: "
            "mount them rigidly, and expose them at the same time"
        )
    # Of noise, by the residuals of a normal distribution's median.
    typical = 1.4826 * float(np.median(np.abs(residuals)))
    spread = max(typical * np.sqrt(residuals.size / (residuals.size - _PARAMETERS)), EXACT)
    curvature = fit.jac.T @ fit.jac
    # What no frame determines gets an error without bounds.
    covariance = spread**2 * np.linalg.inv(curvature + 1e-12 * np.diag(np.diag(curvature)))
    turn_error = float(np.degrees(_widest(covariance[:3, :3])))
    shift_error, scale_error = _widest(covariance[3:6, 3:6]), float(np.sqrt(covariance[12, 12]))
    if turn_error > MOST_TURN or max(shift_error / distance, scale_error) > MOST_SHIFT:
        raise CalibrationError(
            f"their motions determine their mounting to {turn_error:.1f} degrees, "
            f"{100 * shift_error / distance:.0f} % of the distance of the scene and "
            f"{100 * scale_error:.0f} % of its size only: take more frames, and {_TURN_BOTH}"
        )
    b_from_a, a_from_b, scale = _moved(fit.x, start)
    similarity = np.column_stack([scale * a_from_b[:3, :3], a_from_b[:3, 3]])
    return Tie(b_from_a, similarity, turn_error, shift_error, scale_error)


def _require_motion(poses: Array, distance: float) -> None:
    """CalibrationError when there are too few frames, or the rig did not turn about two axes and move."""
    if len(poses) < FEWEST_FRAMES:
        raise CalibrationError(
            f"only {len(poses)} frames have poses of both, and {FEWEST_FRAMES} are needed at least: take "
            f"more frames, and {_TURN_BOTH}"
        )
    turns = Rotation.from_matrix(poses[:, :3, :3])
    turned = np.degrees((turns * turns.mean().inv()).as_rotvec())
    _, second, first = np.sqrt(np.linalg.eigvalsh(turned.T @ turned / len(turned)).clip(0))
    if first < LEAST_TURN:
        raise CalibrationError(
            f"the rig moved without turning, which does not determine the shift: {_TURN_BOTH}"
        )
    if second < LEAST_TURN:
        raise CalibrationError(
            "the rig turned about one axis only, which does not determine the shift along that axis: "
            f"{_TURN_BOTH}"
        )
    # Turned about a point p of its own and q of the world, a camera keeps p = R q + t.
    about = np.concatenate([np.tile(np.eye(3), (len(poses), 1, 1)), -poses[:, :3, :3]], axis=2).reshape(-1, 6)
    shifts = poses[:, :3, 3].ravel()
    residuals = shifts - about @ np.linalg.lstsq(about, shifts, rcond=None)[0]
    if np.sqrt((residuals**2).sum() / len(poses)) < LEAST_MOVE * distance:
        raise CalibrationError(
            "the rig turned about one point, as on a tripod, which does not determine the scale of one "
            "camera against another: walk with it as well, by a tenth of the distance of the scene or more"
        )


def _start(a: Array, b: Array) -> tuple[Array, Array, float]:
    """b_from_a, a's world from b's, both [4, 4], and the ratio of units, in closed form from all motions."""
    one, other = np.triu_indices(len(a), 1)
    by_a, by_b = (poses[other] @ np.linalg.inv(poses[one]) for poses in (a, b))
    # Twice the sine of the angle along the axis, which turns with the frame, at any angle without a leap.
    axes = [
        np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], 1)
        for m in (by_a, by_b)
    ]
    b_from_a = np.eye(4)
    b_from_a[:3, :3] = _nearest_turn(axes[1].T @ axes[0])
    equations = np.concatenate([by_b[:, :3, :3] - np.eye(3), by_b[:, :3, 3:]], axis=2).reshape(-1, 4)
    shifts = (by_a[:, :3, 3] @ b_from_a[:3, :3].T).ravel()
    *b_from_a[:3, 3], scale = np.linalg.lstsq(equations, shifts, rcond=None)[0]
    scale = abs(scale) or 1.0
    every = np.linalg.inv(b_from_a @ a) @ _scaled(b, scale)
    a_from_b = np.eye(4)
    a_from_b[:3, :3] = _nearest_turn(every[:, :3, :3].sum(0))
    a_from_b[:3, 3] = np.median(every[:, :3, 3], axis=0)
    return b_from_a, a_from_b, scale


def _misses(parameters: Array, start: tuple[Array, Array, float], a: Array, b: Array, weight: float) -> Array:
    """Residuals of each frame: rotation, rad, and weighted shift of b against its place by a, [6 N]."""
    b_from_a, a_from_b, scale = _moved(parameters, start)
    apart = b_from_a @ a @ a_from_b @ np.linalg.inv(_scaled(b, scale))
    turn = Rotation.from_matrix(apart[:, :3, :3]).as_rotvec()
    return np.asarray(np.concatenate([turn, weight * apart[:, :3, 3]], axis=1).ravel())


def _moved(parameters: Array, start: tuple[Array, Array, float]) -> tuple[Array, Array, float]:
    """The start, moved by turns and shifts of both poses and by the logarithm of the scale."""
    poses = np.stack(start[:2])
    turns, shifts = np.swapaxes(parameters[:12].reshape(2, 2, 3), 0, 1)
    poses[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix() @ poses[:, :3, :3]
    poses[:, :3, 3] += shifts
    return poses[0], poses[1], start[2] * float(np.exp(parameters[12]))


def _scaled(poses: Array, scale: float) -> Array:
    """The poses in a world of other units."""
    scaled = poses.copy()
    scaled[:, :3, 3] *= scale
    return scaled


def _nearest_turn(matrix: Array) -> Array:
    u, _, vt = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _widest(covariance: Array) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1].clip(0.0)))
