"""Cameras of a rig whose channels differ in sensitivity, made equal by the points that they share.

A scene point has one colour, so what is left between the views of its track, once each camera's matrix
is accounted for, is the sensitivity of each camera's channels: `ln rgb = ln (M scene) + ln d`. Matrices that
differ are accounted for by each point's own colour, found in turn with the sensitivities; everything else is
the graph of log ratios that points span between cameras, solved by robust least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.light.falloff import demeaned
from imaging.arrays import Array, Integers, Mask
from imaging.robust import huber_loss, huber_weight, robust_scale
from imaging.session.records import Rung

FEWEST_TRACKS = 100
FEWEST_OBSERVATIONS = 30
"""Fewest observations of a camera, below which its channels stay as they are."""
LEAST = 0.005
"""Relative; channels that differ by less are left alone: points that lie side by side err alike, and on a rig
without any difference they showed 0.2 %, three times what independent points would."""
ROUNDS = 6
HUBER = 1.5
FOLDS = 5
UNIT = "robust whitened loss per held-out track"


@dataclass(frozen=True, eq=False)
class ColourObservations:
    """Colours of scene points in the views that see them; rows are observations.

    point: int [N], which scene point; camera: int [N]; colour: float64 [N, 3], natural log of camera RGB,
    vignetting divided out.
    """

    point: Integers
    camera: Integers
    colour: Array

    def part(self, keep: Mask) -> "ColourObservations":
        """The observations that `keep` [N] names."""
        return ColourObservations(self.point[keep], self.camera[keep], self.colour[keep])


@dataclass(frozen=True)
class Balance:
    """Sensitivity of red, green and blue of each camera relative to the rig, and standard errors (relative).

    Errors count points as independent of each other. Empty where it was not taken.
    """

    channels: dict[str, tuple[float, float, float]]
    errors: dict[str, tuple[float, float, float]]
    rungs: tuple[Rung, ...]


def estimate(
    observations: ColourObservations,
    cameras: Sequence[str],
    matrices: Sequence[Array],
    anchors: Sequence[str] = (),
) -> Balance:
    """Sensitivities of channels that held-out tracks ask for.

    Args:
        observations: Colours of scene points in the views that see them.
        cameras: Names, in the order of `ColourObservations.camera`.
        matrices: camera_from_rec709 [3, 3] of each camera, in the same order.
        anchors: Names of cameras whose white is known, as from a chart: theirs stays in the mean. Without any
            the rig's does.

    Returns:
        Sensitivities and their errors, of cameras with `FEWEST_OBSERVATIONS` or more; empty where held-out
        tracks do not ask for them.
    """
    _, track = np.unique(observations.point, return_inverse=True)
    shared = np.isin(np.arange(len(cameras)), observations.camera)
    if len(np.unique(track)) < FEWEST_TRACKS or shared.sum() < 2:
        reason = (
            f"fewer than {FEWEST_TRACKS} scene points are seen well, in every channel, by several cameras"
        )
        return Balance({}, {}, (Rung(name="white_balance", taken=False, reason=reason),))
    stack = np.array(matrices)
    gain, error = _gain(observations, stack)
    rung = Rung.judged(
        "white_balance",
        gain,
        error,
        UNIT,
        "a sensitivity for each channel of each camera, not one for each camera",
    )
    if not rung.taken:
        return Balance({}, {}, (rung,))
    logs, covariance = _solve(observations, stack)
    uneven = float(np.abs(logs - logs.mean(axis=1, keepdims=True)).max())
    if uneven < LEAST:
        reason = f"no channel of a camera differs from its others by more than {100 * uneven:.2g} %"
        return Balance({}, {}, (rung.model_copy(update={"taken": False, "reason": reason}),))
    reason = f"{rung.reason}; a channel differs from its others by up to {100 * uneven:.2g} %"
    rung = rung.model_copy(update={"reason": reason})
    fixed = np.array([name in anchors and shared[i] for i, name in enumerate(cameras)])
    fixed = fixed if fixed.any() else shared
    to_gauge = np.eye(len(cameras)) - np.outer(np.ones(len(cameras)), fixed / fixed.sum())
    logs = to_gauge @ logs
    errors = np.sqrt(np.maximum(np.einsum("ij,cjk,ik->ic", to_gauge, covariance, to_gauge), 0.0))
    count = np.bincount(observations.camera, minlength=len(cameras))
    known = [i for i in range(len(cameras)) if count[i] >= FEWEST_OBSERVATIONS]
    return Balance(
        {cameras[i]: triple(np.exp(logs[i])) for i in known},
        {cameras[i]: triple(errors[i]) for i in known},
        (rung,),
    )


def folded(
    camera_from_rec709: Array, channels: tuple[float, float, float]
) -> tuple[Array, tuple[float, float, float], float]:
    """A camera's matrix with the sensitivities in it, its balance relative to green, and its gain.

    The matrix keeps a green row that sums to 1, so that what green has of its own is the gain.
    """
    balance = np.array(channels) / channels[1]
    return balance[:, None] * camera_from_rec709, triple(balance), channels[1]


def _gain(observations: ColourObservations, matrices: Array) -> tuple[float, float]:
    """Gain of three sensitivities a camera over one in predicting held-out tracks, and its error."""
    _, number = np.unique(observations.point, return_inverse=True)
    fold = number % FOLDS
    differences = []
    for held in range(FOLDS):
        rest, test = observations.part(fold != held), observations.part(fold == held)
        logs, _ = _solve(rest, matrices)
        one = np.repeat(logs.mean(axis=1, keepdims=True), 3, axis=1)
        low, high = (_residual(test, matrices, each) for each in (one, logs))
        scale = max(robust_scale(low), 1e-6)
        _, track = np.unique(test.point, return_inverse=True)
        losses = [huber_loss(each / scale, HUBER).mean(axis=1) for each in (low, high)]
        differences.append(np.bincount(track, losses[0] - losses[1]) / np.bincount(track))
    gains = np.concatenate(differences)
    return float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains)))


def _solve(observations: ColourObservations, matrices: Array) -> tuple[Array, Array]:
    """Log sensitivities [C, 3], zero in the mean of every channel, and their covariances [3, C, C]."""
    count = len(matrices)
    logs = np.zeros((count, 3))
    covariance = np.zeros((3, count, count))
    _, track = np.unique(observations.point, return_inverse=True)
    weight = np.ones(observations.colour.shape)
    columns = (observations.camera[:, None] == np.arange(count)).astype(np.float64)
    for _ in range(ROUNDS):
        target = _as_one_camera(observations, matrices, logs)
        for channel in range(3):
            residual = demeaned(
                (target[:, channel] - logs[observations.camera, channel])[:, None], weight[:, channel], track
            )
            scale = max(robust_scale(residual), 1e-6)
            weight[:, channel] = huber_weight(residual[:, 0], HUBER * scale)
            design = demeaned(columns, weight[:, channel], track)
            value = demeaned(target[:, [channel]], weight[:, channel], track)[:, 0]
            normal = design.T @ (design * weight[:, [channel]])
            # A camera that shares no point, and the gauge of all, are left at zero.
            inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
            logs[:, channel] = inverse @ (design.T @ (weight[:, channel] * value))
            covariance[channel] = scale**2 * inverse
        logs -= logs.mean(axis=0)
    return logs, covariance


def _as_one_camera(observations: ColourObservations, matrices: Array, logs: Array) -> Array:
    """ln rgb [N, 3] as a camera of the rig's mean matrix would have seen each point."""
    return np.asarray(observations.colour - _predicted(observations, matrices, logs))


def _residual(observations: ColourObservations, matrices: Array, logs: Array) -> Array:
    """Return what the sensitivities leave between the views of each track, [N, 3]."""
    _, track = np.unique(observations.point, return_inverse=True)
    residual = _as_one_camera(observations, matrices, logs) - logs[observations.camera]
    return np.stack(
        [demeaned(residual[:, [c]], np.ones(len(residual)), track)[:, 0] for c in range(3)], axis=1
    )


def _predicted(observations: ColourObservations, matrices: Array, logs: Array) -> Array:
    """ln of what each point becomes in its camera, over what it becomes in the mean camera, [N, 3]."""
    _, track = np.unique(observations.point, return_inverse=True)
    scene = np.linalg.solve(
        matrices[observations.camera], np.exp(observations.colour - logs[observations.camera])[..., None]
    )[..., 0]
    # The brightness of a point drops out, so its views count alike whatever their exposure says.
    scene /= np.maximum(np.abs(scene).sum(axis=1, keepdims=True), 1e-12)
    mean = np.stack([np.bincount(track, column) for column in scene.T], axis=1) / np.bincount(track)[:, None]
    point = mean[track]
    here = np.einsum("nij,nj->ni", matrices[observations.camera], point)
    there = point @ matrices.mean(axis=0).T
    floor = 1e-3 * np.abs(point).sum(axis=1, keepdims=True)
    return np.asarray(np.log(np.maximum(here, floor) / np.maximum(there, floor)))


def triple(values: Array) -> tuple[float, float, float]:
    """Red, green and blue as plain numbers."""
    red, green, blue = (float(value) for value in values)
    return red, green, blue
