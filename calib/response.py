"""The response of a camera that develops its own photographs: sRGB, or a curve where the data want one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.codes import HIGHEST, LOWEST, Samples
from calib.curve import Array, Channel, Model, Noise, channel_of, fit, fit_rising, huber, neighbours, noise_of
from imaging.calibration import Response
from imaging.records import Rung

SMOOTHNESS = (1e3, 1e4, 1e5, 1e6)
"""Weights of the squared third differences, tried on held-out samples; noise-whitened."""
NEARLY = 1.04
"""A simpler curve is preferred up to this much held-out loss: exposures in equal steps say nothing about
ripples of that period, so only smoothness keeps them out, and no held-out sample would notice them."""
SAFE = 1e5
"""Smoothness where only two exposures differ: they are one step apart, and hold nothing out."""
FOLDS = 3
FEWEST = 300
"""Photosites below which nothing is measured."""
NODES = np.unique(np.concatenate([np.arange(1, 24, 2), np.arange(24, 248, 8), np.arange(248, 256)])).astype(
    float
)


@dataclass(frozen=True)
class Estimate:
    """A response and its ladder; shift: natural log of exposure over label, by ln of the label (rounded)."""

    response: Response
    rungs: tuple[Rung, ...]
    shift: dict[float, float]


@dataclass(frozen=True, eq=False)
class _Judged:
    """Held-out: mean loss per sample of each group, in units of the noise; median disagreement."""

    loss: Array
    median: float


def assumed(evidence: str) -> Estimate:
    """sRGB, for want of anything better, saying so."""
    return Estimate(
        Response(kind="srgb", evidence=evidence),
        (Rung(name="response_curve", taken=False, reason=evidence),),
        {},
    )


def estimate(samples: Samples | None) -> Estimate:
    """The response that samples support: a curve if it predicts held-out exposures better than sRGB."""
    if samples is None or len(samples.codes) < FEWEST:
        return assumed("sRGB assumed: no view has two exposures that overlap, so nothing can be measured")
    channels = [channel_of(samples, index) for index in range(3)]
    if min(len(channel.group) for channel in channels) < FEWEST:
        return assumed("sRGB assumed: too few pixels are well exposed in two different exposures")
    noise = [noise_of(channel) for channel in channels]
    known = _held_out(channels, noise, None)
    trials = {weight: _held_out(channels, noise, weight) for weight in SMOOTHNESS}
    best = _smoothest(trials) if len(channels[0].steps) > 2 else SAFE
    curve = trials[best]
    gain, error = _gain(known, curve)
    rung = Rung(
        name="response_curve",
        taken=gain > error and not _nearly(known, curve),
        gain=gain,
        standard_error=error,
        unit="whitened log-likelihood per held-out sample",
        reason=f"held-out exposures disagree by {100 * curve.median:.1f} % under a measured curve and by "
        f"{100 * known.median:.1f} % under sRGB",
    )
    fitted = fit_rising(channels, best, noise) if rung.taken else fit(channels, None, noise)
    shift = fitted[0].shift
    shifts = dict(zip(channels[0].steps.tolist(), shift.tolist(), strict=True))
    if not rung.taken:
        evidence = (
            f"sRGB: held-out exposures agree with it to {100 * known.median:.1f} %, no curve betters that"
        )
        return Estimate(Response(kind="srgb", evidence=evidence, residual=known.median), (rung,), shifts)
    return Estimate(_exported(channels, fitted, known, curve), (rung,), shifts)


def _gain(worse: _Judged, better: _Judged) -> tuple[float, float]:
    """Mean gain per sample over the held-out groups, and its standard error, paired."""
    gain = worse.loss - better.loss
    gain = gain[np.isfinite(gain)]
    return float(gain.mean()), float(gain.std(ddof=1) / np.sqrt(len(gain)))


def _nearly(simple: _Judged, best: _Judged) -> bool:
    return float(np.nanmean(simple.loss)) <= NEARLY * float(np.nanmean(best.loss))


def _smoothest(trials: Mapping[float, _Judged]) -> float:
    best = min(trials.values(), key=lambda judged: float(np.nanmean(judged.loss)))
    return max(weight for weight, judged in trials.items() if _nearly(judged, best))


def _exported(
    channels: Sequence[Channel], fitted: Sequence[Model], known: _Judged, curve: _Judged
) -> Response:
    low, high = _covered(channels)
    return Response(
        kind="curve",
        codes=tuple((NODES / 255.0).round(8).tolist()),
        log_exposure=tuple(tuple(model.curve(NODES).round(6).tolist()) for model in fitted),
        valid=(low / 255.0, high / 255.0),
        evidence=f"curve measured from {sum(len(c.code) for c in channels)} overlapping samples; held-out "
        f"exposures agree to {100 * curve.median:.1f} % (under sRGB to {100 * known.median:.1f} %)",
        residual=curve.median,
    )


def _held_out(channels: Sequence[Channel], noise: Sequence[Noise], smoothness: float | None) -> _Judged:
    groups = int(max(channel.group.max() for channel in channels)) + 1
    folds = np.arange(groups) % FOLDS
    losses, counts, medians = np.zeros(groups), np.zeros(groups), []
    for fold in range(FOLDS):
        training = [channel.only(folds[channel.group] != fold) for channel in channels]
        testing = [channel.only(folds[channel.group] == fold) for channel in channels]
        if not all(len(part.code) for part in (*training, *testing)):
            continue
        for channel, model, own in zip(testing, fit(training, smoothness, noise), noise, strict=True):
            sigma = own.of(channel)
            owner = channel.group[channel.site]
            losses += np.bincount(
                owner, weights=huber(model.residuals(channel, sigma) / sigma), minlength=groups
            )
            counts += np.bincount(owner, minlength=groups)
            medians.append(_disagreement(channel, model))
    with np.errstate(invalid="ignore"):
        return _Judged(losses / np.where(counts > 0, counts, np.nan), float(np.median(medians)))


def _disagreement(channel: Channel, model: Model) -> float:
    """Median difference, natural log, of the light that neighbouring exposures of a photosite tell."""
    light = model.light(channel)
    first, second = neighbours(channel)
    return float(np.median(np.abs(light[first] - light[second])))


def _covered(channels: Sequence[Channel]) -> tuple[float, float]:
    """Codes between which every channel has samples."""
    low, high = LOWEST, HIGHEST
    for channel in channels:
        counts, edges = np.histogram(channel.code, bins=np.linspace(0.0, 256.0, 65))
        filled = np.flatnonzero(counts >= 10)
        low, high = max(low, edges[filled[0]]), min(high, edges[filled[-1] + 1] - 1.0)
    return float(low), float(high)
