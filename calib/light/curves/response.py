"""The response of a camera that develops its photographs: the simplest curve that the data do not refute."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from calib.light.curves.codes import FEWEST, FOLDS, HIGHEST, LOWEST, Samples
from calib.light.curves.response_band import standard_errors
from calib.light.curves.response_curve import (
    HUBER,
    Channel,
    CodeNoise,
    CurveModel,
    channels_of,
    fit,
    label_trust,
    neighbours,
    noise_of,
)
from calib.light.curves.response_models import Blend, Gamma, Known, Shape, Spline
from imaging.arrays import Array, Mask
from imaging.robust import huber_loss
from imaging.session.calibration import Response
from imaging.session.records import Rung

LADDER: tuple[tuple[Shape, ...], ...] = (
    (Known(),),
    (Gamma(),),
    tuple(Blend(terms) for terms in range(3, 8)),
    tuple(Spline(smoothness) for smoothness in (1e6, 1e5, 1e4, 1e3)),
)
"""Ladder from the simplest shape to the freest; of each rung the variants, the simplest first."""
NEARLY, HARDLY = 1.04, 0.01
"""A simpler curve is preferred up to this much held-out loss, as a factor, or per sample and stop by which
exposures are more than one apart: exposures in equal steps say nothing about ripples of that period, so only
smoothness keeps them out, and no held-out sample would notice them; and the wider the steps, the less a
ripple has to bend. At four stops the second is a third of the standard deviation of the noise."""
ODD = 5.0
"""Ratio to the median loss under the freest curve above which groups are left out of all judgements:
something moved there, or alignment left a border.
"""
DISTRUSTED = 0.1
"""Trust below which a label counts as wrong: it is off by 15 % or more."""
NODES = np.arange(1.0, 256.0)
"""Codes that a curve is written at: all of 8 bits, since a shoulder is too steep for straight lines."""
RUNGS = frozenset(
    {
        "response_curve",
        "response_gamma",
        "response_blend",
        "response_spline",
        "exposure_labels",
        "exposure_of_a_file",
    }
)
"""Names of all rungs that an estimate may have."""
UNIT = "whitened log-likelihood per held-out sample"


@dataclass(frozen=True)
class Estimate:
    """A response and its ladder; shift: natural log of exposure over label, by ln of the label (rounded)."""

    response: Response
    rungs: tuple[Rung, ...]
    shift: dict[float, float]


@dataclass(frozen=True, eq=False)
class Judged:
    """A shape, held out: mean loss per sample of each group, in units of the noise; median disagreement.

    rises: whether it did, however it was fitted.
    """

    shape: Shape
    loss: Array
    median: float
    rises: bool

    @property
    def mean(self) -> float:
        """Mean loss over the groups."""
        return float(np.nanmean(self.loss))

    def without(self, odd: Mask) -> "Judged":
        """The same without some groups."""
        return replace(self, loss=np.where(odd, np.nan, self.loss))


def assumed(evidence: str) -> Estimate:
    """sRGB, for want of anything better, saying so."""
    return Estimate(
        Response(kind="srgb", evidence=evidence),
        (Rung(name="response_curve", taken=False, reason=evidence),),
        {},
    )


def estimate(samples: Samples | None) -> Estimate:
    """The response that samples support: the simplest that predicts held-out exposures as well as any."""
    if samples is None or len(samples.codes) < FEWEST:
        return assumed(
            "sRGB assumed: no view and no point that views share has two exposures, so nothing can "
            "be measured; take two exposures or more of a view, 1 to 3 stops apart"
        )
    channels = channels_of(samples)
    if min(len(channel.group) for channel in channels) < FEWEST:
        return assumed(
            "sRGB assumed: too few pixels are well exposed in two different exposures; "
            "take exposures 1 to 3 stops apart that are neither black nor white all over"
        )
    noise = [noise_of(channel) for channel in channels]
    ladder = [
        [
            held_out(channels, noise, shape, labels_hold=samples.rough)
            for shape in variants
            # Two exposures are one step apart and say nothing about ripples: only stiff splines are tried.
            if not isinstance(shape, Spline) or len(channels[0].steps) > 2 or shape.smoothness >= 1e5
        ]
        # A free curve would follow what gloss and edges do to rough samples.
        for variants in (LADDER[:-1] if samples.rough else LADDER)
    ]
    freest = min(ladder[-1], key=lambda trial: trial.mean).loss
    odd = freest > ODD * np.nanmedian(freest)
    ladder = [[trial.without(odd) for trial in trials] for trials in ladder]
    known = ladder[0][0]
    stops = float(np.median(np.diff(channels[0].steps))) / np.log(2.0)
    hardly = HARDLY * max(stops - 1.0, 0.0)
    best, rival, rungs = _climbed(ladder, channels, noise, hardly)
    held = held_out(channels, noise, best.shape, labels_hold=True).without(odd)
    freed, rung = _exposures(held, best, channels[0], samples.rough)
    fitted = fit(channels, best.shape, noise, labels_hold=not freed)
    every = np.unique(samples.log_k.round(6))  # padding has a label of its view
    contradiction = _contradiction(channels[0].steps, fitted[0].shift, every) if freed else ""
    rungs.append(rung.model_copy(update={"reason": f"{rung.reason}{contradiction}"}))
    shift = dict(zip(channels[0].steps.tolist(), fitted[0].shift.tolist(), strict=True))
    if best is known:
        evidence = (
            f"sRGB: held-out exposures agree with it to {100 * known.median:.1f} %, no curve betters "
            f"that{contradiction}"
        )
        return Estimate(Response(kind="srgb", evidence=evidence, residual=known.median), tuple(rungs), shift)
    response = _exported(channels, fitted, known, best)
    response = response.model_copy(update={"evidence": f"{response.evidence}{contradiction}"})
    sigma = standard_errors(channels, fitted, noise, NODES, labels_hold=not freed)
    # What the preference for a simple curve may hide: how far the keenest of its kind is from it.
    others = fit(channels, rival.shape, noise, labels_hold=not freed)
    sigmas = tuple(
        tuple(np.hypot(deviation, model.curve(NODES) - other.curve(NODES)).round(6).tolist())
        for deviation, model, other in zip(sigma, fitted, others, strict=True)
    )
    return Estimate(response.model_copy(update={"sigma": sigmas}), tuple(rungs), shift)


def _climbed(
    ladder: Sequence[Sequence[Judged]], channels: Sequence[Channel], noise: Sequence[CodeNoise], hardly: float
) -> tuple[Judged, Judged, list[Rung]]:
    """The simplest shape that data do not refute, the keenest of its kind, and the rungs above the first."""
    best = rival = ladder[0][0]
    rungs = []
    for trials in ladder[1:]:
        keenest = min(trials, key=lambda trial: trial.mean)
        near = [trial for trial in trials if not _clearly_worse(trial, keenest, hardly)]
        trial = next((trial for trial in near if trial.rises), near[0])
        rung = _judge(rival, trial, hardly)
        if rung.taken and not all(model.rises() for model in fit(channels, trial.shape, noise)):
            rung = rung.model_copy(update={"taken": False, "reason": f"a {trial.shape.name} does not rise"})
        rungs.append(rung)
        if rung.taken:
            best, rival = trial, keenest
    return best, rival, rungs


def _clearly_worse(simple: Judged, freer: Judged, hardly: float) -> bool:
    return simple.mean > max(NEARLY * freer.mean, freer.mean + hardly)


def _judge(simple: Judged, freer: Judged, hardly: float) -> Rung:
    """Return whether a freer shape is worth it, paired over the held-out groups; `simple`: the best of its
    rung.
    """
    gain = simple.loss - freer.loss
    gain = gain[np.isfinite(gain)]
    value, error = float(gain.mean()), float(gain.std(ddof=1) / np.sqrt(len(gain)))
    return Rung(
        name=f"response_{freer.shape.name.split()[0]}",
        taken=value > error and _clearly_worse(simple, freer, hardly),
        gain=value,
        standard_error=error,
        unit=UNIT,
        reason=f"held-out exposures disagree by {100 * freer.median:.1f} % under a {freer.shape.name} and by "
        f"{100 * simple.median:.1f} % under {simple.shape.name}",
    )


def _exposures(held: Judged, best: Judged, channel: Channel, rough: bool) -> tuple[bool, Rung]:
    """Return whether the exposures differ from their labels; with two that is undecidable, as it is where
    nothing but their labels ties those of some views to those of others.

    held: with the exposures of the labels; best: with others, but for rough samples: an exposure that stands
    in one view alone is indistinguishable from a change of that view.
    """
    steps, reason = len(channel.steps), ""
    if steps < 3:
        reason = "two exposures do not determine a ratio beside the curve: the labels are taken as they are"
    if rough:
        reason = "no view shows two exposures of one place: the labels are taken as they are"
    elif not reason and not _tied(channel):
        reason = "no view has exposures of both of some labels: the labels are taken as they are"
    if reason:
        return False, Rung(name="exposure_labels", taken=False, reason=reason)
    gain = held.loss - best.loss
    gain = gain[np.isfinite(gain)]
    value, error = float(gain.mean()), float(gain.std(ddof=1) / np.sqrt(len(gain)))
    taken = value > error and held.mean > NEARLY * best.mean
    return taken, Rung(
        name="exposure_labels",
        taken=taken,
        gain=value,
        standard_error=error,
        unit=UNIT,
        reason=f"held-out exposures disagree by {100 * best.median:.1f} % with exposures of their own and by "
        f"{100 * held.median:.1f} % with those of the labels",
    )


def _tied(channel: Channel) -> bool:
    """Return whether photosites seen in several exposures tie all of these together."""
    sites, steps = channel.site.max() + 1, len(channel.steps)
    graph = sparse.csr_array(
        (np.ones(len(channel.site)), (channel.site, sites + channel.step)), (sites + steps,) * 2
    )
    part = connected_components(graph, directed=False)[1]
    return bool((part[sites:] == part[sites]).all())


def _contradiction(labels: Array, shift: Array, every: Array) -> str:
    """Return the labels that are far off; or, where fewer than three agree, that they cannot be
    identified.

    every: labels of all exposures, by which they are numbered: nearly black ones are not measured.
    """
    wrong = label_trust(labels, shift) < DISTRUSTED
    if not wrong.any():
        return ""
    if (~wrong).sum() < 3:
        return (
            "; the exposure labels contradict each other and too few agree to show which is wrong, so scale "
            "and exponent of the curve are a guess: state the exposures, or take four or more"
        )
    named = [
        f"exposure {np.searchsorted(every, label) + 1} of {len(every)}, counted from the shortest, is "
        f"{np.exp(change):.3g} times its label"
        for label, change in zip(labels[wrong], shift[wrong], strict=True)
    ]
    return "; " + ", ".join(named)


def _exported(
    channels: Sequence[Channel], fitted: Sequence[CurveModel], known: Judged, curve: Judged
) -> Response:
    low, high = _covered(channels)
    return Response(
        kind="curve",
        codes=tuple((NODES / 255.0).round(8).tolist()),
        log_exposure=tuple(tuple(model.curve(NODES).round(6).tolist()) for model in fitted),
        valid=(low / 255.0, high / 255.0),
        evidence=f"{curve.shape.name}, measured from {sum(len(c.code) for c in channels)} overlapping "
        f"samples; held-out exposures agree to {100 * curve.median:.1f} %, "
        f"under sRGB to {100 * known.median:.1f} %",
        residual=curve.median,
    )


def held_out(
    channels: Sequence[Channel], noise: Sequence[CodeNoise], shape: Shape, *, labels_hold: bool = False
) -> Judged:
    """Held-out loss of a shape, fitted to some parts of the views and applied to the exposures of others.

    Args:
        channels: Samples of each channel; their groups are parts of the views, numbered alike.
        noise: Noise of the codes of each channel.
        shape: Shape of the curve.
        labels_hold: True to take the exposures of the labels as they are; else they are fitted along.

    Returns:
        The shape with its loss in each part, NaN for parts without samples that were held out.
    """
    groups = int(max(channel.group.max() for channel in channels)) + 1
    folds = np.arange(groups) % FOLDS
    losses, counts, medians, rises = np.zeros(groups), np.zeros(groups), [], True
    for fold in range(FOLDS):
        training = [channel.only(folds[channel.group] != fold) for channel in channels]
        testing = [channel.only(folds[channel.group] == fold) for channel in channels]
        if not (all(len(part.code) for part in training) and any(len(part.code) for part in testing)):
            continue
        models = fit(training, shape, noise, labels_hold=labels_hold)
        rises &= all(model.rises() for model in models)
        for channel, model, codes_noise in zip(testing, models, noise, strict=True):
            sigma = codes_noise.of(channel)
            owner = channel.group[channel.site]
            loss = huber_loss(model.residuals(channel, sigma) / sigma, HUBER)
            losses += np.bincount(owner, weights=loss, minlength=groups)
            counts += np.bincount(owner, minlength=groups)
            if len(channel.code):
                medians.append(_disagreement(channel, model))
    with np.errstate(invalid="ignore"):
        return Judged(shape, losses / np.where(counts > 0, counts, np.nan), float(np.median(medians)), rises)


def _disagreement(channel: Channel, model: CurveModel) -> float:
    """Median difference, natural log, of a photosite's light between neighbouring exposures."""
    light = model.light(channel)
    first, second = neighbours(channel)
    return float(np.median(np.abs(light[first] - light[second])))


def _covered(channels: Sequence[Channel]) -> tuple[float, float]:
    """Codes between which some channel has samples.

    Not every one: under coloured light their codes hardly overlap, but what clips them is the same. Where one
    has none the standard errors of its curve say how far it is to be trusted.
    """
    bins = np.linspace(0.0, 256.0, 65)
    counts = np.stack([np.histogram(channel.code, bins)[0] for channel in channels])
    filled = np.flatnonzero((counts >= 10).any(0))
    return max(LOWEST, 4.0 * float(filled[0])), min(HIGHEST, 4.0 * float(filled[-1]) + 3.0)
