"""Colours of which degree a scene is given, and how many Gaussians.

The degree follows from what scene points look like from all sides (`recon.decide.steps.view_dependence`). The
preset names the most Gaussians; from there trials halve the count for as long as the views that judge them
lose little.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from imaging.arrays import Array
from imaging.session.records import Rung
from recon.data.dataset import Dataset
from recon.decide.evidence import Evidence, Run
from recon.decide.held_out_evidence import STEPS, fitted_view
from recon.decide.presets import START_SHARE
from recon.decide.settings import Settings
from recon.decide.steps.view_dependence import FEWEST_POINTS, FEWEST_VIEWS, Gains, gains, looks
from recon.decide.trials import SAMPLES, Trials, room, too_few_views
from recon.observe.refinement import Refined
from recon.scene.harmonics import DEGREE
from recon.scene.ply import most_gaussians
from recon.start.initialisation import Start
from recon.train.devices.ranks import Ranks

COUNT, COLOUR = "number of Gaussians", "direction-dependent colour"
TRIAL_SHARE = 0.1
"""Share of the training's iterations that a trial takes."""
LOSS = 0.25
"""dB that fewer Gaussians may lose in a trial: on the demo and the gallery, 160 px wide, those that are
chosen by it lose 0.08 and 0.14 dB of the light in a whole training (bench/recon/parts/count.py)."""
MATERIAL = (0.45, 0.2)
"""dB that a higher degree has to gain for sure, by one standard error, over 0 and over 1. Scenes without any
gloss seem to gain 0.05 to 0.41 of RAW and, as photographs of 96 px, 0.40 to 0.63 with errors of 0.14 to 0.35;
the gallery gains 0.59 to 0.92, a scene of much gloss more than 2. On the demo degree 0 costs 0.12 dB of the
picture, on the gallery, which seems to gain 0.16 by degree 2 over 1, degree 1 costs 0.04
(bench/results/ablation.md); lego, which seems to gain 0.36 by it, does gain 0.3 dB of its pictures."""
UNDECIDED = 0
"""Degree if too few views see the same points to decide. Of four and of eight views of the demo and the
gallery it has 0.1 to 0.4 dB more of the light than degree 2, even where surfaces shine
(bench/results/few_views.md).
"""
EACH, FLOOR = 1500, 10_000
"""Most Gaussians for each training view where these are too few for trials, but for drafts, and the fewest
that this leaves: what more of them learn in a whole training, one view alone sees (bench/real/counts.py)."""
MOST_HALVINGS = 5
PLAIN = 14
"""Numbers of a Gaussian whose colour is the same from everywhere: place, size, turn, opacity, colour."""
FEWEST = 50
"""Gaussians that a trial is made with."""
UNIT = "dB of the pictures of views held out of a trial"
COLOUR_UNIT = "dB of the luminance of scene points, each look predicted from all others"
_ALONE = Ranks()


def degree_for(run: Run, evidence: Evidence, points: Array | None = None) -> tuple[int, Rung]:
    """The degree of the harmonics, and why: as asked, else by the evidence.

    Args:
        run: Running reconstruction; a degree that was set by hand overrides the evidence.
        evidence: The views, with the scene points of their calibration.
        points: Of the scene [P, 3], where calibration has none.

    Returns:
        The degree, and its rung, whose parameters are those of one Gaussian.
    """
    gained, asked = None, run.asked.overrides.degree
    if asked is not None:
        degree, reason = asked, "as asked for"
    else:
        gained = gains(looks(evidence.dataset, evidence.images, points))
        if gained is None:
            degree = UNDECIDED
            reason = (
                f"since fewer than {FEWEST_POINTS} scene points are seen by {FEWEST_VIEWS} training views, "
                "so that nothing shows that more is needed"
            )
        else:
            degree = lowest(gained)
            steps = " and ".join(
                f"{more} {gained.db[more]:.2f} +- {gained.error[0, more]:.2f}"
                for more in range(1, DEGREE + 1)
            )
            reason = (
                f"the lowest above which none surely gains {MATERIAL[min(degree, 1)]:g} dB: over 0 at "
                f"{gained.points} scene points gain {steps}"
            )
    # Of colours that stay the same everywhere, the rung has what the better of the others would gain.
    best = degree or (0 if gained is None else int(gained.db.argmax()) or 1)
    rung = Rung(
        name=COLOUR,
        taken=degree > 0,
        gain=None if gained is None else float(gained.db[best]),
        standard_error=None if gained is None else float(gained.error[0, best]),
        unit="" if gained is None else COLOUR_UNIT,
        reason=f"harmonics of degree {degree}, {reason}",
        parameters=3 * ((degree + 1) ** 2 - 1),
    )
    return degree, rung


def lowest(gained: Gains) -> int:
    """The lowest degree above which none gains as much as is material, less its standard error."""
    for low in range(DEGREE):
        more = gained.db[low + 1 :] - gained.db[low]
        if not (more - gained.error[low, low + 1 :] > MATERIAL[low]).any():
            return low
    return DEGREE


def gaussians_for(
    run: Run,
    evidence: Evidence,
    settings: Settings,
    against_trials: str | None,
    degree: int,
    refined: Sequence[Refined],
    points: Start,
) -> tuple[int, Rung]:
    """Number of Gaussians, and the reason: as asked, else by trials, else by the samples there are.

    Args:
        run: Running reconstruction.
        evidence: The views.
        settings: Of the training, with the most Gaussians that it may have.
        against_trials: The reason against trials, or None if they are allowed.
        degree: Of the harmonics, also of those in trials; a budget in bytes holds fewer Gaussians of a higher
            one.
        refined: Corrections that the training makes.
        points: The start of a training of `most_for` Gaussians.

    Returns:
        The most Gaussians of the training, and the rung of their number.
    """
    most = most_for(evidence.dataset, settings, degree)
    if _asked(settings):
        reason = f"at most {most:,}, as asked for"
    elif against_trials is None:
        trials = Trials.of(evidence.dataset, settings, points, run.progress, run.device)
        return Ladder(trials, refined, most, degree).climbed()
    else:
        reason = f"at most {most:,}, {against_trials}"
        enough = max(EACH * len(evidence.dataset.train), FLOOR)
        if settings.quality != "draft" and too_few_views(evidence.dataset) and enough < most:
            most = enough
            reason = (
                f"at most {most:,}, {EACH:,} for each training view or {FLOOR:,}: with "
                "too few views for trials, more would learn what one view alone sees"
            )
        elif most < settings.max_gaussians:
            reason += (
                f"; one for every {SAMPLES} samples of the training views, which can distinguish no more"
            )
    taken = most < settings.max_gaussians
    return most, Rung(name=COUNT, taken=taken, reason=reason, parameters=PLAIN * most)


def most_for(dataset: Dataset, settings: Settings, degree: int) -> int:
    """The most Gaussians that the scene may be given: as asked for, else of the preset, if it has room."""
    if settings.budget is not None and settings.budget_unit == "bytes":
        return min(settings.max_gaussians, most_gaussians(settings.budget, degree))
    return settings.max_gaussians if _asked(settings) else min(settings.max_gaussians, room(dataset))


def _asked(settings: Settings) -> bool:
    return settings.overrides.gaussians is not None or settings.budget_unit in ("Gaussians", "bytes")


@dataclass
class Ladder:
    """Trials of one session, each trained once. measured: dB of each view, by count.

    Where the most are worse than fewer, no longer training has use for them either: with 80,000 the gallery
    is 0.2 dB above 40,000 in trials of 200 iterations, 0.4 below in 400, and after 4,000 has 1.0 dB less of
    the light than with 25,000. Lego, of 100 views, is best with the most in 300 iterations as in 1,000.
    """

    trials: Trials
    refined: Sequence[Refined]
    most: int
    degree: int
    measured: dict[int, Array] = field(default_factory=dict)

    def climbed(self) -> tuple[int, Rung]:
        """The fewest Gaussians that lose little, and why."""
        counts = [self.most]
        means = [float(self.db(self.most).mean())]
        while len(counts) <= MOST_HALVINGS and counts[-1] // 2 >= FEWEST and max(means) - means[-1] < LOSS:
            counts.append(counts[-1] // 2)
            means.append(float(self.db(counts[-1]).mean()))
        count = fewest(counts, means)
        near = min(counts, key=lambda tried: abs(np.log(tried / count)))
        gain, error = _paired(self.db(near), self.db(self.most))
        tried_counts = ", ".join(f"{mean:.2f} dB with {c:,}" for c, mean in zip(counts, means, strict=True))
        number = Rung(
            name=COUNT,
            taken=count < self.most,
            gain=gain,
            standard_error=error,
            unit=UNIT,
            reason=f"{count:,} of at most {self.most:,}, the fewest that lose less than {LOSS:g} dB in "
            f"trainings of {self.iterations} iterations: {tried_counts}",
            parameters=PLAIN * count,
        )
        return count, number

    @property
    def iterations(self) -> int:
        """Iterations of a trial."""
        settings = self.trials.settings
        return max(1, round(TRIAL_SHARE * settings.iterations * settings.batch))

    def db(self, count: int) -> Array:
        """Quality in every judging view, [views], of a training with that many Gaussians."""
        if count not in self.measured:
            trials, fitted = self.trials, bool({*self.refined} & {"poses", "exposures"})
            if not self.measured:
                halvings = sum(self.most >> step >= FEWEST for step in range(1, MOST_HALVINGS + 1))
                fits = len(trials.judged) * STEPS if fitted else 0
                trials.steps.total = (1 + halvings) * (self.iterations + fits)
            training = trials.trained(
                self.iterations,
                count,
                f"a trial with {count:,} Gaussians",
                refine=tuple(self.refined),
                degree=self.degree,
                points=fewer(trials.points, int(START_SHARE * count), trials.settings.seed),
            )
            unsure, extent = tuple(self.refined), trials.part.extent
            views = []
            for view in trials.judged:
                views.append(fitted_view(training, view, unsure, extent))
                if fitted:
                    trials.fitted(STEPS, f"judging {count:,} Gaussians")
            figures = [training.held_out_psnr((view,), 1.0, _ALONE) for view in views]
            self.measured[count] = np.array(figures)
        return self.measured[count]


def fewest(counts: list[int], means: list[float]) -> int:
    """Return where dB over the logarithm of the count, falling counts, come to `LOSS` below the best."""
    line = max(means) - LOSS
    last = max(place for place, mean in enumerate(means) if mean >= line)
    if last == len(counts) - 1:
        return counts[last]
    share = (means[last] - line) / (means[last] - means[last + 1])
    return int(counts[last] * (counts[last + 1] / counts[last]) ** share)


def fewer(points: Start, count: int, seed: int) -> Start:
    """`count` of the points as `start_points` would have it: SfM points as far as they go, then others."""
    if count >= len(points.xyz):
        return points
    rng = np.random.Generator(np.random.PCG64([seed, count]))
    sparse = min(points.sparse, count)
    rows = np.concatenate(
        [
            np.sort(rng.choice(points.sparse, sparse, replace=False)),
            points.sparse
            + np.sort(rng.choice(len(points.xyz) - points.sparse, count - sparse, replace=False)),
        ]
    )
    return replace(points, xyz=points.xyz[rows], rgb=points.rgb[rows], sparse=sparse)


def _paired(ours: Array, theirs: Array) -> tuple[float, float]:
    """Mean difference over views, and its standard error."""
    difference = ours - theirs
    return float(difference.mean()), float(difference.std(ddof=1) / np.sqrt(len(difference)))
