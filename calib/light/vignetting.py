"""Falloff towards the corners, and cameras of unequal sensitivity, from points that several views see.

A scene point is as bright in every view (away from gloss), so what differs between the views of its
track is the lens and the camera: `ln E = ln L_point + ln gain_camera + ln V(r)`. Points are eliminated by
taking each track's mean away; what is left is a small robust least-squares problem (Goldman, "Vignette
and exposure calibration and compensation", 2010, gives the model).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from calib.light.viewing_sides import by_side
from imaging.robust import huber_loss, huber_weight, robust_scale
from imaging.session.records import ONE_OF_SEVERAL, Rung

Array = npt.NDArray[np.float64]
Coefficients = tuple[float, float, float]

FEWEST_TRACKS = 100
ROUNDS = 30
SETTLED = 1e-4
"""Change of every number, absolute, at which a fit has come to its end."""
HALVINGS = 12
"""Of a step, before it is given up."""
HUBER = 1.5
"""Residuals beyond this many standard deviations count linearly: gloss, occlusion, wrong matches."""
FOLDS = 5
NOTICED = 0.005
"""Less than this, natural log of light anywhere in any camera, is left out: by chance alone one trial in six
gains more than its standard error, and such a part of the light nobody misses."""
NOTICED_IN_SHEEN = 0.02
"""And so much where surfaces shine: views of one side still see unlike sheen, which passes for sensitivities
that differ by 0.8 to 1.6 % on the glossy scenes of bench/recon/ladder_scenes.py, whose cameras are alike."""
DARKEST = 0.05
"""Share of the light of the middle that a lens leaves at least; what is darker is a hood, or no picture."""
AT_BOUND = 1.02
TOO_DARK = (
    f"somewhere less than {100 * DARKEST:g} % of the light of the middle arrives, as behind a hood or beyond "
    "the image circle, which no falloff describes: mask what is dark, or shoot flats"
)
RADII = np.linspace(0.0, 1.0, 41)
"""Where a falloff has to be above that."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Brightness of scene points in the views that see them; rows are observations.

    point: int [N], which scene point; camera: int [N]; radius: float64 [N], 1 at the corner of the
    image; brightness: float64 [N], natural log of merged luminance; direction: float64 [N, 3], unit, from the
    point to the camera.
    """

    point: npt.NDArray[np.int64]
    camera: npt.NDArray[np.int64]
    radius: Array
    brightness: Array
    direction: Array

    def apart(self, groups: Sequence[int]) -> "Tracks":
        """The same with a point told apart by the group of the cameras, as many as `camera` counts, that see
        it: those that look through different filters see different light of it."""
        own = np.array(groups, np.int64)[self.camera]
        return replace(self, point=self.point * (max(groups, default=0) + 1) + own)

    def part(self, keep: npt.NDArray[np.bool_]) -> "Tracks":
        """The observations that `keep` [N] names."""
        return Tracks(
            self.point[keep],
            self.camera[keep],
            self.radius[keep],
            self.brightness[keep],
            self.direction[keep],
        )


@dataclass(frozen=True)
class Falloff:
    """What was found, by camera name."""

    vignetting: dict[str, Coefficients]
    gain: dict[str, float]
    rungs: tuple[Rung, ...]


@dataclass(frozen=True)
class _Shape:
    """Which terms a fit has: a falloff for each group of cameras, a gain for each camera."""

    lenses: tuple[int, ...]
    """Group of each camera; empty: no falloff."""
    gains: bool

    def parameters(self, cameras: int) -> int:
        """Numbers that are fitted; the mean of the gains is not one."""
        return 3 * len(set(self.lenses)) + (cameras - 1) * self.gains


@dataclass(frozen=True, eq=False)
class _Fit:
    polynomials: Array
    log_gain: Array
    scale: float


def estimate(
    tracks: Tracks, cameras: Sequence[str], models: Mapping[str, str], *, comparable: bool = True
) -> Falloff:
    """Falloff and gains that held-out tracks ask for, and nothing else.

    cameras: names, in the order of `Tracks.camera`; models: of each camera, by name. Cameras of one
    model share a falloff unless their own predict held-out tracks better. Of falloff and gains the one that
    tells more is tried first, so that it does not pass for the other. comparable: whether the cameras see the
    same light; if not, they get no gains.
    """
    count = len(cameras)
    none = _Shape((), gains=False)
    nothing = Falloff(dict.fromkeys(cameras, (0.0, 0.0, 0.0)), dict.fromkeys(cameras, 1.0), ())
    _, tracks_of = np.unique(tracks.point, return_inverse=True)
    if len(np.unique(tracks_of)) < FEWEST_TRACKS:
        reason = f"fewer than {FEWEST_TRACKS} scene points are seen well in several views"
        return Falloff(
            nothing.vignetting, nothing.gain, (Rung(name="vignetting", taken=False, reason=reason),)
        )
    groups = {model: index for index, model in enumerate(dict.fromkeys(models[name] for name in cameras))}
    shared = tuple(groups[models[name]] for name in cameras)
    shape, rungs, noticed = none, list[Rung](), NOTICED
    both = _Shape(shared, gains=comparable and count > 1)
    if (shines := _shines(tracks, both, count)) is not None:
        rung, sides = shines
        rungs.append(rung)
        if rung.taken:
            tracks, noticed = sides, NOTICED_IN_SHEEN

    def climb(name: str, wanted: _Shape, what: str) -> None:
        nonlocal shape
        gain, error = _gain(tracks, shape, wanted, count)
        more = wanted.parameters(count) - shape.parameters(count)
        rung = Rung.judged(
            name, gain, error, "robust whitened loss per held-out track", what, more, ONE_OF_SEVERAL
        )
        fits = [_fit(tracks, one, count) for one in (shape, wanted)] if rung.taken else []
        if fits and _darkest(fits[1].polynomials) < AT_BOUND * DARKEST:
            rung = rung.model_copy(update={"taken": False, "reason": TOO_DARK})
        elif fits:
            before, after = (_light(fit, one) for fit, one in zip(fits, (shape, wanted), strict=True))
            change = float(np.abs(after - before).max())
            if change < noticed:
                reason = f"{what} would change no light by more than {100 * change:.2f} %"
                reason += ", and sheen changes as much" if noticed > NOTICED else ""
                rung = rung.model_copy(update={"taken": False, "reason": reason})
        rungs.append(rung)
        if rung.taken:
            shape = wanted

    taller = {
        "vignetting": (replace(none, lenses=shared), "one falloff for each camera model"),
        "camera_gain": (replace(none, gains=True), "a sensitivity for each camera"),
    }
    if count == 1:
        del taller["camera_gain"]
    for name in sorted(taller, key=lambda name: -_gain(tracks, none, taller[name][0], count)[0]):
        own, what = taller[name]
        climb(name, _Shape(shape.lenses or own.lenses, shape.gains or own.gains), what)
    if shape.lenses and count > len(groups):
        climb("vignetting_each_camera", _Shape(tuple(range(count)), shape.gains), "a falloff for each camera")
    found = _fit(tracks, shape, count)
    vignetting = nothing.vignetting
    if shape.lenses:
        vignetting = {name: _row(found.polynomials[shape.lenses[i]]) for i, name in enumerate(cameras)}
    gain = {name: float(np.exp(found.log_gain[i])) for i, name in enumerate(cameras)}
    return Falloff(vignetting, gain, tuple(rungs))


def _shines(tracks: Tracks, shape: _Shape, cameras: int) -> tuple[Rung, Tracks] | None:
    """Whether points look different from different sides, and each side of a point as a track of its own.

    A sheen that faces the cameras is brightest in the middle of every view, as if lenses fell off. Views
    that look from nearly the same side see alike sheen: what they tell of the lens is told by both, or the
    others tell of the surface. None where too few points are seen twice from one side.
    """
    sides = by_side(tracks.point, tracks.direction)
    twice = np.bincount(sides)[sides] >= 2
    if len(np.unique(sides[twice])) < FEWEST_TRACKS:
        return None
    near = replace(tracks, point=sides)
    fold = np.unique(tracks.point, return_inverse=True)[1] % FOLDS
    differences = []
    for held in range(FOLDS):
        test = near.part((fold == held) & twice)
        whole = _fit(tracks.part(fold != held), shape, cameras)
        own = _fit(near.part((fold != held) & twice), shape, cameras)
        differences.append(_loss(test, whole, shape, own.scale) - _loss(test, own, shape, own.scale))
    gains = np.concatenate(differences)
    rung = Rung.judged(
        "vignetting_by_side",
        float(gains.mean()),
        float(gains.std(ddof=1) / np.sqrt(len(gains))),
        "robust whitened loss per held-out track",
        "falloff and sensitivities from views that look from nearly the same side, since surfaces shine",
    )
    return rung, near.part(twice)


def _row(values: Array) -> Coefficients:
    a, b, c = (float(value) for value in values)
    return a, b, c


def _gain(tracks: Tracks, low: _Shape, high: _Shape, cameras: int) -> tuple[float, float]:
    """By how much `high` predicts held-out tracks better than `low`, and the standard error of that."""
    _, own = np.unique(tracks.point, return_inverse=True)
    fold = own % FOLDS
    differences = []
    for held in range(FOLDS):
        rest, test = tracks.part(fold != held), tracks.part(fold == held)
        fits = [_fit(rest, shape, cameras) for shape in (low, high)]
        scale = fits[0].scale
        losses = [_loss(test, fit, shape, scale) for fit, shape in zip(fits, (low, high), strict=True)]
        differences.append(losses[0] - losses[1])
    gains = np.concatenate(differences)
    return float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains)))


def _loss(tracks: Tracks, fit: _Fit, shape: _Shape, scale: float) -> Array:
    """Mean Huber loss of each track under a fit."""
    residual = _residual(tracks, fit, shape)
    _, own = np.unique(tracks.point, return_inverse=True)
    loss = huber_loss(demeaned(residual[:, None], np.ones(len(residual)), own)[:, 0] / scale, HUBER)
    return np.asarray(np.bincount(own, loss) / np.bincount(own))


def _fit(tracks: Tracks, shape: _Shape, cameras: int) -> _Fit:
    """Gauss-Newton on the polynomials, re-weighted by Huber's function; no step that makes the fit worse.

    Steep falloff bends ln V so much that whole steps lead across zero, where there is no logarithm.
    """
    lenses = max(shape.lenses, default=-1) + 1
    fit = _Fit(np.zeros((lenses, 3)), np.zeros(cameras), 1.0)
    _, own = np.unique(tracks.point, return_inverse=True)
    weight = np.ones(len(own))
    powers = radial_powers(tracks.radius)
    lens = np.array(shape.lenses or [0] * cameras)[tracks.camera]
    for _ in range(ROUNDS):
        residual = demeaned(_residual(tracks, fit, shape)[:, None], weight, own)[:, 0]
        scale = max(robust_scale(residual), 1e-6)
        weight = huber_weight(residual, HUBER * scale)
        columns = []
        if lenses:
            slope = powers / _falloff(tracks, fit, shape)[:, None]
            columns += [np.where((lens == g)[:, None], slope, 0.0) for g in range(lenses)]
        if shape.gains:
            columns.append((tracks.camera[:, None] == np.arange(cameras)).astype(np.float64))
        if not columns:
            return _Fit(fit.polynomials, fit.log_gain, scale)
        design = demeaned(np.concatenate(columns, axis=1), weight, own)
        residual = demeaned(_residual(tracks, fit, shape)[:, None], weight, own)[:, 0]
        normal = design.T @ (design * weight[:, None])
        # A trace of ridge settles the gauge of the gains and what the radii seen leave open.
        normal += 1e-9 * max(float(np.trace(normal)), 1e-12) * np.eye(len(normal))
        step = np.linalg.solve(normal, design.T @ (weight * residual))
        taken = _stepped(tracks, replace(fit, scale=scale), shape, np.asarray(step), weight, own)
        if taken is None:
            return replace(fit, scale=scale)
        fit = taken
        if np.abs(step).max() < SETTLED:
            break
    return fit


def _stepped(
    tracks: Tracks, fit: _Fit, shape: _Shape, step: Array, weight: Array, own: npt.NDArray[np.int64]
) -> _Fit | None:
    """The fit after a step that is halved until it does no harm; None if it always does."""

    def cost(one: _Fit) -> float:
        return float(
            (weight * demeaned(_residual(tracks, one, shape)[:, None], weight, own)[:, 0] ** 2).sum()
        )

    numbers, before = fit.polynomials.size, cost(fit)
    for halving in range(HALVINGS):
        part = step * 0.5**halving
        polynomials = fit.polynomials + part[:numbers].reshape(fit.polynomials.shape)
        if _darkest(polynomials) < DARKEST:
            continue
        log_gain = fit.log_gain + (part[numbers:] if shape.gains else 0.0)
        trial = _Fit(polynomials, log_gain - log_gain.mean(), fit.scale)
        if cost(trial) <= before:
            return trial
    return None


def _darkest(polynomials: Array) -> float:
    """Least light that falloffs [G, 3] leave at any radius, of the middle."""
    return float((1.0 + polynomials @ radial_powers(RADII).T).min(initial=1.0))


def _light(fit: _Fit, shape: _Shape) -> Array:
    """Natural log of what each camera leaves of the light at each of `RADII`, [cameras, R], in the mean 0."""
    light = np.repeat(fit.log_gain[:, None], len(RADII), axis=1)
    if shape.lenses:
        light += np.log(1.0 + fit.polynomials[np.array(shape.lenses)] @ radial_powers(RADII).T)
    return np.asarray(light - light.mean())


def _falloff(tracks: Tracks, fit: _Fit, shape: _Shape) -> Array:
    if not shape.lenses:
        return np.ones(len(tracks.radius))
    own = fit.polynomials[np.array(shape.lenses)[tracks.camera]]
    return light_left(own, tracks.radius)


def _residual(tracks: Tracks, fit: _Fit, shape: _Shape) -> Array:
    return np.asarray(tracks.brightness - np.log(_falloff(tracks, fit, shape)) - fit.log_gain[tracks.camera])


def radial_powers(radius: Array) -> Array:
    """Second, fourth and sixth power of radii [N], 1 at the corner of the sensor: [N, 3]."""
    return np.asarray(radius[:, None] ** np.array([2, 4, 6]))


def light_left(polynomials: Array, radius: Array) -> Array:
    """What falloffs [N, 3] leave of the light at radii [N], each of its own; 1 in the middle."""
    return np.asarray(1.0 + (polynomials * radial_powers(radius)).sum(axis=1))


def demeaned(values: Array, weight: Array, own: npt.NDArray[np.int64]) -> Array:
    """Values [N, C] less the weighted mean of their track; own: its number, of each value [N]."""
    total = np.bincount(own, weight)
    means = np.stack([np.bincount(own, weight * column) / total for column in values.T], axis=1)
    return np.asarray(values - means[own])
