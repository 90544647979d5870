"""How well a response curve is known: its standard error at every code, from resampled parts of the views."""

from collections.abc import Sequence

import numpy as np

from calib.curve import FIRM, FLOOR, Channel, Equations, Model, Noise, label_trust, moved, robust
from calib.response_models import MIDDLE, Array

REPLICAS = 200


def standard_errors(
    channels: Sequence[Channel],
    models: Sequence[Model],
    noise: Sequence[Noise],
    codes: Array,
    *,
    labels_hold: bool,
) -> list[Array]:
    """Standard error of ln light at codes, of each channel: a bootstrap over the parts of the views.

    Parts, because pixels near each other err together. Each replica is one step from the fit, which is
    exact as far as the curve is linear in its parameters. The scale is that of the code where all curves
    meet, and of the labels where these hold. What no resampling shows (rounding, the mean of a patch through
    a curve) is counted as `FLOOR` for a factor of e of light, and for more.
    """
    rng = np.random.Generator(np.random.PCG64(0x8E5))
    groups = np.unique(np.concatenate([channel.group for channel in channels]))
    blocks = [
        [_equations(channel, model, own, group) for group in groups]
        for channel, model, own in zip(channels, models, noise, strict=True)
    ]
    normals = [np.stack([block.normal for block in own]) for own in blocks]
    rights = [np.stack([block.right for block in own]) for own in blocks]
    labels = channels[0].steps
    trust = np.full(len(labels), FIRM) if labels_hold else label_trust(labels, models[0].shift)
    drawn = []
    for _ in range(REPLICAS):
        times = np.bincount(rng.integers(len(groups), size=len(groups)), minlength=len(groups)).astype(float)
        parts = [
            Equations(np.tensordot(times, normal, 1), np.tensordot(times, right, 1))
            for normal, right in zip(normals, rights, strict=True)
        ]
        drawn.append([model.curve(codes) for model in moved(models, parts, labels, trust)])
    spread = np.asarray(drawn).std(0)
    middle = np.array([float(MIDDLE)])
    away = np.array([np.minimum(np.abs(model.curve(codes) - model.curve(middle)), 1.0) for model in models])
    return list(np.hypot(spread, FLOOR * away))


def _equations(channel: Channel, model: Model, noise: Noise, group: int) -> Equations:
    part = channel.only(channel.group == group)
    sigma = noise.of(part)
    return Equations.of(part, model, robust(model.residuals(part, sigma) / sigma) / sigma**2)
