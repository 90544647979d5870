"""Decision on light from far away behind the Gaussians: by geometry first, then by a trial."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates, uniform_filter

from imaging.errors import ReconstructionError
from imaging.merge.linear_frame import Float
from imaging.progress import Progress
from imaging.session.records import Rung
from recon.data.dataset import Dataset, View
from recon.data.geometry import inside, project_camera, rays
from recon.data.light import Images
from recon.data.load import again
from recon.decide.corrections import TRIAL_GAUSSIANS, TRIAL_WIDTH, UNIT
from recon.decide.held_out_evidence import robust_score_db
from recon.decide.settings import Settings
from recon.decide.trials import Trials, room
from recon.start.far_light import ALIKE, LUMINANCE
from recon.train.ranks import Ranks

Array = npt.NDArray[np.float64]

NAME = "environment"
SUGGESTED = 0.05
"""Share of the pixels from which on a far field is tried."""
BESIDE, CLEAR = 0.06, 0.03
"""Radians beside a direction, where only plain walls look alike, and the share by which fewer do there that
stands in for a trial. Demo and gallery have 2 % alike, and as many beside; objects before a light probe 18 %,
8 % fewer beside."""
MOST_VIEWS = 12
"""Most views sampled for it, evenly chosen."""
ACROSS = 40
"""Pixels sampled in a row of a view."""
APART = 0.2
"""Least distance of two cameras, as a share of the extent of the rig: nearer ones see near things alike,
too.
"""
FEWEST_LOOKS = 2
TRIAL_LOOKS = 10
"""Iterations a view in a trial; an environment that is worth anything shows at once."""


def environment_for(
    dataset: Dataset,
    settings: Settings,
    images: Images,
    against_trials: str | None,
    ranks: Ranks,
    progress: Progress,
) -> tuple[bool, Rung]:
    """Return whether there is an environment, and why: as asked, else by a trial where geometry suggests one.

    images: radiance images of the training views. The same on all ranks.
    """
    asked = settings.overrides.environment
    if dataset.bands:
        if asked:
            raise ReconstructionError(
                f"{dataset.session} has the light of bands, and an environment that of Rec.709: leave "
                "--set environment=1 out."
            )
        return False, Rung(
            name=NAME, taken=False, reason="the light is that of bands, which it does not have"
        )
    if asked is not None:
        rung = Rung(name=NAME, taken=asked, reason="asked for" if asked else "left out, as asked for")
    elif ranks.first:
        rung = _by_evidence(dataset, settings, images, against_trials, progress)
    else:
        rung = Rung(name=NAME, taken=False, reason="as the first process decided")
    return bool(ranks.broadcast(float(rung.taken))), rung


def _by_evidence(
    dataset: Dataset,
    settings: Settings,
    images: Images,
    against_trials: str | None,
    progress: Progress,
) -> Rung:
    if all(view.transparent for view in dataset.train):
        return Rung(name=NAME, taken=False, reason="where the photographs are transparent there is nothing")
    share, beside = (far_share(dataset.train, images, turn) for turn in (0.0, BESIDE))
    seen = (
        f"{100 * share:.0f} % of the views show the same light in the same direction from all places, and "
        f"{100 * beside:.0f} % in directions beside it"
    )
    if share < SUGGESTED:
        return Rung(name=NAME, taken=False, reason=f"{seen}: too few for a far field")
    if against_trials is not None:
        return Rung(name=NAME, taken=share - beside > CLEAR, reason=f"{seen}; a trial: {against_trials}")
    return tried(dataset, settings, seen, progress)


def tried(dataset: Dataset, settings: Settings, seen: str, progress: Progress) -> Rung:
    """A short training without an environment and one with, judged on views that neither saw."""
    if settings.max_width > TRIAL_WIDTH:
        small = again(dataset, TRIAL_WIDTH, progress)
        dataset = replace(settings.overrides.subset(small), watched=dataset.watched)
    most = min(TRIAL_GAUSSIANS, room(dataset))
    trials = Trials.from_new_points(dataset, settings, most // 2, progress)
    iterations, extent = TRIAL_LOOKS * len(trials.part.train), trials.part.extent
    trials.steps.total = 2 * iterations
    plain, far = (
        trials.trained(iterations, most, f"a trial {how} a far field", environment=there)
        for how, there in (("without", False), ("with", True))
    )
    gains = [
        robust_score_db(far, view, (), extent) - robust_score_db(plain, view, (), extent)
        for view in trials.judged
    ]
    return Rung.judged(
        NAME,
        float(np.mean(gains)),
        float(np.std(gains, ddof=1) / np.sqrt(len(gains))),
        UNIT,
        f"{seen}; two trainings of {iterations} iterations, judged on {len(gains)} views held out of both",
    )


def far_share(views: tuple[View, ...], images: Images, turn: float = 0.0) -> float:
    """Share of the pixels in whose direction most views from other places see the same light.

    images: radiance images of the views. turn: radians by which the others look beside it, to and fro.
    """
    logs = [_log(rgb) for rgb, _ in images]
    centres = np.array([view.centre for view in views])
    apart = APART * np.linalg.norm(centres - centres.mean(0), axis=1).max()
    chosen = np.unique(np.linspace(0, len(views) - 1, MOST_VIEWS).round().astype(int))
    agreed, total = 0, 0
    for one in chosen:
        lens = views[one].lens
        step = max(1, lens.width // ACROSS)
        grid = np.mgrid[step // 2 : lens.height : step, step // 2 : lens.width : step]
        y, x = grid.reshape(2, -1)
        own = views[one].seen[y, x]
        y, x = y[own], x[own]
        directions = rays(lens, np.stack([x, y], 1) + 0.5) @ lens.cam_from_world[:3, :3]
        if turn:
            aside = lens.cam_from_world[0, :3] * np.linalg.norm(directions, axis=1, keepdims=True)
            directions = directions + np.tan(turn) * np.where(np.arange(len(x)) % 2, 1, -1)[:, None] * aside
        differences = np.full((len(views), len(x)), np.nan)
        for other, view in enumerate(views):
            if np.linalg.norm(centres[other] - centres[one]) > apart:
                differences[other] = np.abs(_at(view, logs[other], directions) - logs[one][y, x])
        looks = np.isfinite(differences).sum(0)
        alike = (differences < ALIKE).sum(0)
        agreed += int(((looks >= FEWEST_LOOKS) & (2 * alike > looks)).sum())
        total += len(x)
    return agreed / max(total, 1)


def _log(rgb: Float) -> Array:
    """Natural log of luminance [H, W], a little smoothed: noise and half a pixel do not count."""
    light = uniform_filter(np.maximum(rgb @ LUMINANCE, 0), 5)
    return np.asarray(np.log(np.maximum(light, max(float(np.percentile(light, 99)) * 1e-6, 1e-30))))


def _at(view: View, log: Array, directions: Array) -> Array:
    """Return what a view sees in far directions [D, 3]; NaN where it sees nothing."""
    pixels, depth = project_camera(view.lens, directions @ view.lens.cam_from_world[:3, :3].T)
    shown = inside(view.lens, pixels, depth)
    found = np.full(len(directions), np.nan)
    x, y = pixels[shown].T
    light = map_coordinates(log, [y - 0.5, x - 0.5], order=1, mode="nearest")
    found[shown] = np.where(view.seen[np.floor(y).astype(int), np.floor(x).astype(int)], light, np.nan)
    return found
