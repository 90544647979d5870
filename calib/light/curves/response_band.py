"""Standard error of a response curve at every code, from resampled parts of the views."""

from collections.abc import Sequence

import numpy as np

from calib.light.curves.response_curve import (
    FIRM,
    FLOOR,
    HUBER,
    Channel,
    CodeNoise,
    CurveModel,
    Equations,
    label_trust,
    moved,
)
from calib.light.curves.response_models import MIDDLE
from imaging.arrays import Array
from imaging.robust import huber_weight

REPLICAS = 200


def standard_errors(
    channels: Sequence[Channel],
    models: Sequence[CurveModel],
    noise: Sequence[CodeNoise],
    codes: Array,
    *,
    labels_hold: bool,
) -> list[Array]:
    """Standard error of ln light at codes, of each channel: a bootstrap over the parts of the views.

    Parts, because pixels near each other err together. Each replica is one step from the fit, which is
    exact as far as the curve is linear in its parameters. The scale is that of the code where all curves
    meet. What no resampling shows (rounding, the mean of a patch through a curve) is counted as `FLOOR` for a
    factor of e of light, and for more; and where labels do not hold, the exponent that they leave open.
    """
    rng = np.random.Generator(np.random.PCG64(0x8E5))
    groups = np.unique(np.concatenate([channel.group for channel in channels]))
    blocks = [
        [_equations(channel, model, channel_noise, group) for group in groups]
        for channel, model, channel_noise in zip(channels, models, noise, strict=True)
    ]
    normals = [np.stack([block.normal for block in channel_noise]) for channel_noise in blocks]
    rights = [np.stack([block.right for block in channel_noise]) for channel_noise in blocks]
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
    away = np.array([np.abs(model.curve(codes) - model.curve(middle)) for model in models])
    exponent = 0.0 if labels_hold else _exponent_error(labels, models[0].shift, trust)
    return list(np.sqrt(spread**2 + (FLOOR * np.minimum(away, 1.0)) ** 2 + (exponent * away) ** 2))


def _exponent_error(labels: Array, shift: Array, trust: Array) -> float:
    """Standard error, relative, of the exponent that scattered labels leave to the curve.

    It is the slope of a line through the shifts, whose scatter measures the errors of labels.
    """
    centred = labels - (trust * labels).sum() / trust.sum()
    scatter = (trust * shift**2).sum() / max(trust.sum() - 2.0, 1.0)
    return float(np.sqrt(scatter / (trust * centred**2).sum()))


def _equations(channel: Channel, model: CurveModel, noise: CodeNoise, group: int) -> Equations:
    part = channel.only(channel.group == group)
    sigma = noise.of(part)
    return Equations.of(part, model, huber_weight(model.residuals(part, sigma) / sigma, HUBER) / sigma**2)
