"""How many Gaussians a scene is given, and colours of which degree: by short trainings, else by its samples.

The preset names the most. From there trials halve the count for as long as the views that judge them lose
little; then harmonics of a lower degree are tried with about as many Gaussians as were chosen.
"""

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import torch

from imaging.records import Rung
from recon.dataset import Dataset
from recon.harmonics import DEGREE
from recon.live_curve import held_out_db
from recon.model import Settings
from recon.pixels import Progress
from recon.presets import START_SHARE
from recon.ranks import Ranks
from recon.refinement import Refinement
from recon.refinement_evidence import fitted_view
from recon.start import Start
from recon.trials import SAMPLES, Trials, no_trial, room

COUNT, COLOUR = "number of Gaussians", "direction-dependent colour"
TRIAL_SHARE = 0.1
"""Of the training's iterations, what a trial takes."""
LOSS = 0.35
"""dB that fewer Gaussians may lose in a trial. Short trainings need more of them to get as far: a loss of so
much is one of 0.2 dB or less after a whole training (bench/count.py)."""
CLEAR = 3.0
"""Standard errors: where harmonics gain more, the full degree is taken without a look at those between."""
MOST_HALVINGS = 5
PLAIN = 14
"""Numbers of a Gaussian whose colour is the same from everywhere: place, size, turn, opacity, colour."""
FEWEST = 50
"""Gaussians that a trial is made with."""
UNIT = "dB of the pictures of views held out of a trial"
_ALONE = Ranks()

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Size:
    """What was decided. gaussians: at most; degree: of the harmonics."""

    gaussians: int
    degree: int
    rungs: tuple[Rung, ...]


def size_for(
    dataset: Dataset,
    settings: Settings,
    refined: Refinement,
    points: Start,
    ranks: Ranks,
    progress: Progress,
    device: torch.device,
) -> Size:
    """The size of a training with these settings; as asked, else as decided; the same on all ranks.

    points: what a training of `most_for` Gaussians would start from.
    """
    size = decided(dataset, settings, refined, points, progress, device) if ranks.first else None
    if size is None:
        size = Size(0, 0, ())  # only the first one writes why
    return Size(int(ranks.told(size.gaussians)), int(ranks.told(size.degree)), size.rungs)


def most_for(dataset: Dataset, settings: Settings) -> int:
    """The most Gaussians that the scene may be given: as asked for, else of the preset, if it has room."""
    return settings.max_gaussians if _asked(settings) else min(settings.max_gaussians, room(dataset))


def _asked(settings: Settings) -> bool:
    return settings.fixed.gaussians is not None or settings.budget_unit in ("Gaussians", "bytes")


def decided(
    dataset: Dataset,
    settings: Settings,
    refined: Refinement,
    points: Start,
    progress: Progress,
    device: torch.device,
) -> Size:
    """Both rungs: by what is fixed, else by trials, else by the samples there are and the method's degree."""
    fixed, why_not = settings.fixed, no_trial(dataset, settings)
    most = most_for(dataset, settings)
    if not why_not:
        return Ladder(Trials.of(dataset, settings, points, progress), refined, most, device).climbed()
    degree = DEGREE if fixed.degree is None else fixed.degree
    reason = f"at most {most:,}, {why_not}"
    if _asked(settings):
        reason = f"at most {most:,}, as asked for"
    elif most < settings.max_gaussians:
        reason += f"; one for every {SAMPLES} samples of the training views, which can tell no more apart"
    colour = f"harmonics of degree {degree}, " + ("as asked for" if fixed.degree is not None else why_not)
    rungs = (
        Rung(name=COUNT, taken=most < settings.max_gaussians, reason=reason, parameters=PLAIN * most),
        Rung(name=COLOUR, taken=degree > 0, reason=colour, parameters=_terms(degree) * most),
    )
    return Size(most, degree, rungs)


@dataclass
class Ladder:
    """Trials of one session, each trained once. heard: dB of each view, by count and degree."""

    trials: Trials
    refined: Refinement
    most: int
    device: torch.device
    heard: dict[tuple[int, int], Array] = field(default_factory=dict)

    def climbed(self) -> Size:
        """The number first, then the degree."""
        counts = [self.most]
        means = [float(self.db(self.most, DEGREE).mean())]
        while len(counts) <= MOST_HALVINGS and counts[-1] // 2 >= FEWEST and max(means) - means[-1] < LOSS:
            counts.append(counts[-1] // 2)
            means.append(float(self.db(counts[-1], DEGREE).mean()))
        count = fewest(counts, means)
        near = min(counts, key=lambda tried: abs(np.log(tried / count)))
        gain, error = _paired(self.db(near, DEGREE), self.db(self.most, DEGREE))
        told = ", ".join(f"{mean:.2f} dB with {c:,}" for c, mean in zip(counts, means, strict=True))
        number = Rung(
            name=COUNT,
            taken=count < self.most,
            gain=gain,
            standard_error=error,
            unit=UNIT,
            reason=f"{count:,} of at most {self.most:,}, the fewest that lose less than {LOSS:g} dB in "
            f"trainings of {self.iterations} iterations: {told}",
            parameters=PLAIN * count,
        )
        degree, colour = self.degree(near, count)
        return Size(count, degree, (number, colour))

    def degree(self, near: int, count: int) -> tuple[int, Rung]:
        """The lowest degree above which no step gains more than its standard error, tried at `near`."""
        gain, error = _paired(self.db(near, DEGREE), self.db(near, 0))
        chosen, tried = (DEGREE if gain > error else 0), "0"
        if chosen and gain < CLEAR * error:
            more, doubt = _paired(self.db(near, DEGREE), self.db(near, 1))
            chosen, tried = (DEGREE if more > doubt else 1), "0 and 1"
        rung = Rung(
            name=COLOUR,
            taken=chosen > 0,
            gain=gain,
            standard_error=error,
            unit=UNIT,
            reason=f"harmonics of degree {chosen}; {DEGREE} was tried against {tried} in trainings of "
            f"{self.iterations} iterations",
            parameters=_terms(chosen) * count,
        )
        return chosen, rung

    @property
    def iterations(self) -> int:
        """Of a trial."""
        settings = self.trials.settings
        return max(1, round(TRIAL_SHARE * settings.iterations * settings.batch))

    def db(self, count: int, degree: int) -> Array:
        """Quality of every view that judges, [views], of a training with so many and this degree."""
        if (count, degree) not in self.heard:
            trials = self.trials
            training = trials.trained(
                self.iterations,
                count,
                f"a trial with {count:,} Gaussians, degree {degree}",
                refine=tuple(self.refined.parameters),
                degree=degree,
                haste=1 / TRIAL_SHARE,
                points=fewer(trials.points, int(START_SHARE * count), trials.settings.seed),
                device=self.device,
            )
            unsure, extent = tuple(self.refined.parameters), trials.part.extent
            views = [fitted_view(training, view, unsure, extent) for view in trials.judged]
            told = [held_out_db(training, (view,), 1.0, _ALONE) for view in views]
            self.heard[count, degree] = np.array(told)
        return self.heard[count, degree]


def fewest(counts: list[int], means: list[float]) -> int:
    """Where dB over the logarithm of the count, falling counts, come to `LOSS` below the best."""
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


def _terms(degree: int) -> int:
    """Numbers of a Gaussian's colour that depend on the direction."""
    return 3 * ((degree + 1) ** 2 - 1)
