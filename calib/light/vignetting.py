"""Falloff towards the corners and sensitivities of the cameras, as held-out regions ask for them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from calib.light.falloff import DARKEST, Fit, Terms, Tracks, darkest, fit_terms, log_light, track_losses
from calib.request import ASKED, LightPart
from imaging.arrays import Array, Integers
from imaging.optics.lens import Lens
from imaging.session.records import Rung

Coefficients = tuple[float, float, float]

FEWEST_TRACKS = 100
FOLDS = 5
SURE = 3.0
"""Standard errors between the regions of a scene that a part has to gain: surfaces are not lenses, and there
are few regions."""
SURE_OF_A_LENS = 2.0
"""The same of a falloff of RAW files that is within `LENSES` of the fourth power of the cosine."""
LENSES = (0.25, 3.0)
"""Falloffs of real lenses in natural log of light at the corner, as multiples of that law's: telecentric
lenses have less, open apertures more."""
NOTICED = 0.005
"""Smallest effect, natural log of light between cameras, that is corrected."""
LEAST_FALLOFF = 0.02
"""And a falloff that takes less than this anywhere. One wrongly taken puts as much into every picture."""
NOTICED_IN_SHEEN = 0.02
"""And so much where surfaces shine: views of one side still see unlike sheen, which passes for sensitivities
that differ by 0.8 to 1.6 % on the glossy scenes of bench/recon/parts/ladder_scenes.py, of cameras that are
alike."""
ASIDE = 10.0
"""Degrees between the first view of a side and its others: sheen changes little within them."""
AT_BOUND = 1.02
UNIT = "robust whitened loss per track of a held-out region"
TOO_DARK = (
    f"somewhere less than {100 * DARKEST:g} % of the light of the middle arrives, as behind a hood or beyond "
    "the image circle, which no falloff describes: mask what is dark, or shoot flats"
)
NEUTRAL: Coefficients = (0.0, 0.0, 0.0)
NOTHING = Terms((), gains=False)
PARTS: dict[str, LightPart] = {"vignetting": "falloff", "camera_gain": "gain"}
"""Parts that are tried, as rungs and options name them."""
DESCRIPTION = {
    "vignetting": "one falloff for each camera model",
    "camera_gain": "a sensitivity for each camera",
    "vignetting_each_camera": "a falloff for each camera",
}


@dataclass(frozen=True)
class Falloff:
    """Falloff, by camera name."""

    vignetting: dict[str, Coefficients]
    gain: dict[str, float]
    rungs: tuple[Rung, ...]


def estimate(
    tracks: Tracks,
    cameras: Sequence[str],
    models: Mapping[str, str],
    *,
    comparable: bool = True,
    uncorrected: Mapping[str, float] | None = None,
    without: Collection[LightPart] = (),
) -> Falloff:
    """Estimate the falloff and gains that tracks of held-out regions ask for, and nothing else.

    Cameras of one model share a falloff unless their own predict held-out tracks better. Of falloff and gains
    the one with the larger effect is tried first, so that it is not mistaken for the other.

    Args:
        tracks: Brightness of scene points in the views that see them.
        cameras: Names, in the order of `Tracks.camera`.
        models: Make and model of each camera, by name.
        comparable: True if the cameras see the same light; if not, they get no gains.
        uncorrected: Natural log of light at the corner by the cosine's fourth power, at most 0 (`natural`),
            of each camera whose files are RAW, by name.
        without: Parts to leave out.

    Returns:
        Falloff and gain of every camera, neutral for what is not taken; and a rung for each trial.
    """
    count = len(cameras)
    if not _divisible(tracks.point, tracks.region):
        reason = f"fewer than {FEWEST_TRACKS} scene points are seen well in several views"
        rung = Rung(name="vignetting", taken=False, reason=reason)
        return Falloff(dict.fromkeys(cameras, NEUTRAL), dict.fromkeys(cameras, 1.0), (rung,))
    # Lenses of one model are alike, so their cameras begin with one falloff.
    groups = {model: index for index, model in enumerate(dict.fromkeys(models[name] for name in cameras))}
    shared = tuple(groups[models[name]] for name in cameras)
    terms, rungs, noticed = NOTHING, list[Rung](), NOTICED
    both = Terms(shared, gains=comparable and count > 1 and "gain" not in without)
    # Sheen brightens views from one side as falloff would: where there is any, more is asked of a change.
    if (shines := _shines(tracks, both, count)) is not None:
        rung, sides = shines
        rungs.append(rung)
        if rung.taken:
            tracks, noticed = sides, NOTICED_IN_SHEEN
    judge = partial(_judge, tracks, cameras, uncorrected or {}, noticed)
    # The larger effect first: what it explains is no longer there for the other to be mistaken for.
    rungs += [Rung(name=name, taken=False, reason=ASKED) for name, part in PARTS.items() if part in without]
    trials = {"vignetting": Terms(shared, gains=False), "camera_gain": Terms((), gains=True)}
    trials = {name: trial for name, trial in trials.items() if PARTS[name] not in without}
    if count == 1 or not comparable:
        trials.pop("camera_gain", None)
    for name in sorted(trials, key=lambda name: -_gain(tracks, NOTHING, trials[name], count)[0]):
        wanted = Terms(terms.lenses or trials[name].lenses, terms.gains or trials[name].gains)
        terms, rung = judge(name, terms, wanted)
        rungs.append(rung)
    # A falloff of its own has to predict the held-out tracks of a camera better than that of its model.
    if terms.lenses and count > len(groups):
        terms, rung = judge("vignetting_each_camera", terms, Terms(tuple(range(count)), terms.gains))
        rungs.append(rung)
    fitted = fit_terms(tracks, terms, count)
    vignetting = {
        name: _row(fitted.polynomials[terms.lenses[i]]) if terms.lenses else NEUTRAL
        for i, name in enumerate(cameras)
    }
    gain = {name: float(np.exp(fitted.log_gain[i])) for i, name in enumerate(cameras)}
    return Falloff(vignetting, gain, tuple(rungs))


def _divisible(points: Integers, regions: Integers) -> bool:
    """Return whether tracks are enough for regions to fit on and regions to judge by."""
    return len(np.unique(points)) >= FEWEST_TRACKS and len(np.unique(regions)) >= FOLDS


def _judge(
    tracks: Tracks,
    cameras: Sequence[str],
    uncorrected: Mapping[str, float],
    noticed: float,
    name: str,
    terms: Terms,
    wanted: Terms,
) -> tuple[Terms, Rung]:
    """Return the terms wanted if they predict held-out regions better and change enough, else those before,
    and the reason.
    """
    count, reason = len(cameras), DESCRIPTION[name]
    gain, error = _gain(tracks, terms, wanted, count)
    taken = gain > SURE * error
    if taken or gain > SURE_OF_A_LENS * error:
        before, after = (fit_terms(tracks, one, count) for one in (terms, wanted))
        if taken or (name == "vignetting" and _as_of_lenses(after, wanted, cameras, uncorrected)):
            taken, reason = _worth(name, (before, terms), (after, wanted), noticed)
    rung = Rung(
        name=name,
        taken=taken,
        gain=gain,
        standard_error=error,
        unit=UNIT,
        reason=reason,
        parameters=wanted.parameters(count) - terms.parameters(count),
    )
    return (wanted if taken else terms), rung


def _worth(
    name: str, before: tuple[Fit, Terms], after: tuple[Fit, Terms], noticed: float
) -> tuple[bool, str]:
    """Return whether a part describes a lens and changes enough light, and the reason."""
    if darkest(after[0].polynomials) < AT_BOUND * DARKEST:
        return False, TOO_DARK
    falloff, change = name == "vignetting", log_light(*after) - log_light(*before)
    largest = float(np.ptp(change) if falloff else np.abs(change).max())
    if largest < max(noticed, LEAST_FALLOFF if falloff else 0.0):
        reason = f"{DESCRIPTION[name]} would change no light by more than {100 * largest:.2f} %"
        return False, reason + (", and sheen changes as much" if noticed > NOTICED else "")
    return True, f"{DESCRIPTION[name]}; {_size(name, after[0])}"


def natural(lens: Lens) -> float:
    """Natural log of the light at the corner, the middle's being 0, by the fourth power of the cosine.

    Of an angle of arctan(corner / focal length); a fisheye gets none.
    """
    if lens.fisheye:
        return 0.0
    corner = np.hypot(lens.width / 2 / lens.fx, lens.height / 2 / lens.fy)
    return float(-2.0 * np.log1p(corner**2))


def _as_of_lenses(fit: Fit, terms: Terms, cameras: Sequence[str], uncorrected: Mapping[str, float]) -> bool:
    """Return whether all cameras record RAW, and each falloff is what lenses of this angle have."""
    if not uncorrected.keys() >= set(cameras):
        return False
    corner = np.log(1.0 + fit.polynomials.sum(axis=1))
    law = np.array([uncorrected[name] for name in cameras])
    share = corner[np.array(terms.lenses)] / np.minimum(law, -1e-6)
    return bool(np.all((LENSES[0] <= share) & (share <= LENSES[1])))


def _size(name: str, fit: Fit) -> str:
    """Return what a part changes, in words."""
    if name == "camera_gain":
        spread = float(np.exp(np.ptp(fit.log_gain))) - 1.0
        return f"cameras differ by up to {100 * spread:.2g} %"
    corner = 1.0 + fit.polynomials.sum(axis=1)
    least, most = 100 * float(corner.min()), 100 * float(corner.max())
    share = f"{least:.0f}" if most - least < 1 else f"{least:.0f} to {most:.0f}"
    return f"the corners get {share} % of the light of the middle"


def _shines(tracks: Tracks, terms: Terms, cameras: int) -> tuple[Rung, Tracks] | None:
    """Test whether points look different from different sides, and return each side of a point as a track of
    its own.

    A sheen that faces the cameras is brightest in the middle of every view, as if lenses fell off. Views that
    look from nearly the same side see alike sheen: the lens shows in both, or the others show the surface.
    None where too few points are seen twice from one side.
    """
    sides = by_side(tracks.point, tracks.direction)
    twice = np.bincount(sides)[sides] >= 2
    if not _divisible(sides[twice], tracks.region[twice]):
        return None
    near = replace(tracks, point=sides)
    fold = np.unique(tracks.region, return_inverse=True)[1] % FOLDS
    differences = []
    for held in range(FOLDS):
        out = fold == held
        if not (out & twice).any() or not (~out & twice).any():
            continue
        whole, by_side_tracks = (
            fit_terms(part, terms, cameras) for part in (tracks.part(~out), near.part(~out & twice))
        )
        test = near.part(out & twice)
        losses = [track_losses(test, fit, terms, by_side_tracks.scale) for fit in (whole, by_side_tracks)]
        differences.append(_by_region(test, losses[0] - losses[1]))
    gain, error = _mean_and_error(differences)
    rung = Rung.judged(
        "vignetting_by_side",
        gain,
        error,
        UNIT,
        "falloff and sensitivities from views that look from nearly the same side, since surfaces shine",
    )
    return rung, near.part(twice)


def _row(values: Array) -> Coefficients:
    a, b, c = (float(value) for value in values)
    return a, b, c


def _gain(tracks: Tracks, low: Terms, high: Terms, cameras: int) -> tuple[float, float]:
    """Gain of `high` over `low` in predicting held-out regions, and its standard error."""
    fold = np.unique(tracks.region, return_inverse=True)[1] % FOLDS
    differences = []
    for held in range(FOLDS):
        out = fold == held
        rest, test = tracks.part(~out), tracks.part(out)
        fits = [fit_terms(rest, terms, cameras) for terms in (low, high)]
        scale = fits[0].scale
        losses = [track_losses(test, fit, terms, scale) for fit, terms in zip(fits, (low, high), strict=True)]
        differences.append(_by_region(test, losses[0] - losses[1]))
    return _mean_and_error(differences)


def _by_region(tracks: Tracks, values: Array) -> Array:
    """The mean over each region of a value of each track, in the order of their numbers."""
    if not len(values):
        return values
    _, first = np.unique(tracks.point, return_index=True)
    _, region = np.unique(tracks.region[first], return_inverse=True)
    return np.asarray(np.bincount(region, values) / np.bincount(region))


def _mean_and_error(differences: Sequence[Array]) -> tuple[float, float]:
    """Mean and standard error over all regions."""
    gains = np.concatenate(differences)
    return float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains)))


def by_side(point: Integers, direction: Array) -> Integers:
    """Number of the side that each observation looks from, int64 [N]; sides of different points differ.

    point: of each observation [N]; direction: unit, from the point to the camera [N, 3]. The first
    observation of a point begins a side, those within `ASIDE` join it, the first of the others begins the
    next.
    """
    side = np.full(len(point), -1, np.int64)
    remaining, begun = np.arange(len(point)), 0
    while len(remaining):
        points, first, group = np.unique(point[remaining], return_index=True, return_inverse=True)
        cosine = (direction[remaining] * direction[remaining[first]][group]).sum(1)
        near = cosine >= np.cos(np.radians(ASIDE))
        near[first] = True  # whatever rounding does
        side[remaining[near]] = begun + group[near]
        remaining, begun = remaining[~near], begun + len(points)
    return side
