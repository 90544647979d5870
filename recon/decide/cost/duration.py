"""Duration of a whole reconstruction, stated when one view of each camera is read.

What it does is counted, and each count has its time on a processor. Those were measured on two cores (the
trainings of bench/results/presets.md, and fox as a draft), and hold for others within `SURE`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Self

from imaging.compute.free_share import free_share, if_so
from imaging.compute.threads import thread_count
from imaging.session.session import Session
from recon.data.dataset import View
from recon.data.resident import pixels_of
from recon.decide.cost.memory_need import in_use, trained_pixels
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES
from recon.decide.request import TrainingRequest
from recon.decide.steps import corrections, far_field, size
from recon.decide.trials import FEWEST_VIEWS, HELD_OUT
from recon.train.devices.training_device import training_device
from recon.train.half_size import UNTIL, begins_halved, halves

BEGIN = 10.0
"""Processor seconds of imports, of kernels that were compiled before, and of files that are written."""
READ = 0.05
"""Processor seconds a megapixel of a file."""
SWEEP = 1.5
"""Processor seconds for the depths of a megapixel of a training view."""
STEP, DRAWN, PLANE, GAUSSIAN = 0.005, 0.12, 0.04, 0.5e-6
"""Processor seconds of an iteration: of its own; of its render and of each plane of its shots, by the
megapixel; of a Gaussian.
"""
MEASURED = 3.0
"""Processor seconds a megapixel of a held-out view, in evaluation and report."""
REPORT = 3.0
ON_ALL_CORES = 0.65
"""Share of the time which all cores do (bench/results/budget.md: 37 s of the clock for 55 of a processor)."""
MOST_TRIALS = 1.1
"""Largest share of the training that trials take (`recon.decide.cost.probe.WITH_TRIALS`)."""
SURE = 0.7, 1.6
"""Lower and upper factor on the counted seconds."""
WORTH_SAYING = 30.0
"""Seconds; what is sooner done needs no word."""


@dataclass(frozen=True)
class Work:
    """Counts of what a reconstruction does.

    files: megapixels of all files that are read. view: megapixels of a view as it is trained; planes: of its
    shots. trials, small_trials: iterations at most, at the width of the training and at that of trials, which
    have `small` megapixels a view.
    """

    train: int
    held_out: int
    files: float
    view: float
    planes: float
    iterations: int
    gaussians: int
    trials: int
    small_trials: int
    small: float
    width: int

    @classmethod
    def of(
        cls,
        firsts: Sequence[View],
        counts: Mapping[str, tuple[int, int]],
        files: float,
        iterations: int,
        gaussians: int,
        *,
        tried: bool,
    ) -> Self:
        """firsts: a view of each camera, as it is trained on; counts: of its views, and to train on.

        tried: whether trials may be made.
        """
        views = sum(count for count, _ in counts.values())
        train = sum(count for _, count in counts.values())
        view = sum(counts[one.camera][0] * pixels_of(one) for one in firsts) / views / 1e6
        planes = sum(counts[one.camera][0] * _planes(one) for one in firsts)
        width = max(one.lens.width for one in firsts)
        judged = -(-train // HELD_OUT)
        made = tried and judged >= FEWEST_VIEWS
        looks = corrections.TRIAL_LOOKS * (train - judged)
        corrected = (1 + len(corrections.TRIED)) * max(looks, round(corrections.TRIAL_SHARE * iterations))
        return cls(
            train=train,
            held_out=views - train,
            files=files,
            view=view,
            planes=planes / views,
            iterations=iterations,
            gaussians=gaussians,
            trials=(1 + size.MOST_HALVINGS) * round(size.TRIAL_SHARE * iterations) if made else 0,
            small_trials=corrected if made else 0,
            small=view * min(1.0, corrections.TRIAL_WIDTH / width) ** 2,
            width=width,
        )

    def _pace(self) -> float:
        """Processor seconds of an iteration, in the mean over a training."""
        full, half = (self._step(share * self.view, 0.75 * self.gaussians) for share in (1.0, 0.25))
        return UNTIL * half + (1 - UNTIL) * full if begins_halved(1e6 * self.view, self.gaussians) else full

    def _step(self, view: float, gaussians: float) -> float:
        return step(view, self.planes, gaussians)

    def processor_seconds(self) -> tuple[float, float]:
        """Processor seconds without any trial, and with the most trials; within `SURE`."""
        pace = self._pace()
        plain = (
            BEGIN
            + READ * self.files
            + SWEEP * self.view * self.train
            + pace * self.iterations
            + MEASURED * self.view * self.held_out
            + REPORT
        )
        small = self._step(self.small, corrections.TRIAL_GAUSSIANS)
        trials = pace * self.trials + small * self.small_trials
        far = _far_trial(self.train, self.view, self.planes, self.width)
        return plain, plain + far + min(trials, MOST_TRIALS * pace * self.iterations)

    def clock_seconds(self, cores: int) -> tuple[float, float]:
        """Seconds of the clock, at least and at most, on that many cores that do nothing else."""
        clock = 1 - ON_ALL_CORES + ON_ALL_CORES / cores
        low, high = (clock * sure * s for sure, s in zip(SURE, self.processor_seconds(), strict=True))
        return low, high

    def in_words(self, cores: int, at_most: bool = False, free: float = 1.0) -> str:
        """Return the duration in words on that many cores.

        at_most: whether the training may end before its last iteration. free: share of the cores that other
        work leaves.
        """
        share, condition = if_so(free)
        low, high = (seconds / share for seconds in self.clock_seconds(cores))
        takes = f"at most {words(high)}" if at_most else f"{words(low)} to {words(high)}"
        where = f"{cores} {'core' if cores == 1 else 'cores'}"
        return (
            f"{self.train} training views, {self.width} px wide, {self.iterations:,} iterations on {where}: "
            f"this takes {takes} in all, with its report, {condition}."
        )


def step(view: float, planes: float, gaussians: float) -> float:
    """Processor seconds of an iteration: of that many megapixels, planes of shots, and Gaussians."""
    return STEP + view * (DRAWN + PLANE * planes) + GAUSSIAN * gaussians


def slowdown(views: Sequence[View], gaussians: int) -> float:
    """Times that an iteration at full size takes of one at the half size that a training begins with; 1 if it
    does not.
    """
    if not halves(views, gaussians):
        return 1.0
    view, planes = fmean(map(pixels_of, views)) / 1e6, fmean(map(_planes, views))
    return step(view, planes, gaussians) / step(view / 4, planes, gaussians)


def far_trial(views: Sequence[View], gaussians: int) -> float:
    """Iterations of a training of that many Gaussians that take as long as the trial of a far field."""
    view, planes = fmean(map(pixels_of, views)) / 1e6, fmean(map(_planes, views))
    width = max(one.lens.width for one in views)
    return _far_trial(len(views), view, planes, width) / step(view, planes, gaussians)


def _far_trial(train: int, view: float, planes: float, width: int) -> float:
    """Processor seconds of the trial of a far field; arguments as those of `Work`."""
    tiny = view * min(1.0, far_field.TRIAL_WIDTH / width) ** 2
    trained = train - -(-train // HELD_OUT)
    looks = min(far_field.MOST_ITERATIONS, far_field.TRIAL_LOOKS * trained)
    return 2 * looks * step(tiny, planes, far_field.TRIAL_GAUSSIANS)


def _planes(view: View) -> int:
    return sum(1 if shot.pixels.ndim == 2 else 3 for shot in view.shots)


def how_long(
    session: Path,
    firsts: Sequence[View],
    counts: Mapping[str, tuple[int, int]],
    request: TrainingRequest,
) -> str | None:
    """Return the duration, in words, of a reconstruction that begins now; None: it is short, or a time was
    given.

    None also on GPUs and for bands, where nothing was measured. firsts, counts: as `recon.data.load.load` has
    them.
    """
    opened, budget, overrides = Session.open(session), request.budget, request.overrides
    if (budget is not None and budget.unit == "s") or opened.record.bands or training_device().type != "cpu":
        return None
    used = in_use(counts, overrides.views)
    # The others of the views to train on are read, and no more.
    counts = {name: (views - train + used[name][1], used[name][1]) for name, (views, train) in counts.items()}
    preset, train = QUALITIES[request.quality], sum(count for _, count in counts.values())
    work = Work.of(
        tuple(map(overrides.bracket, firsts)),
        counts,
        sum(shot.width * shot.height for shot in opened.shots("scene")) / 1e6,
        overrides.iterations or preset.iterations_of(train),
        request.most_gaussians(train, trained_pixels(firsts, counts), overrides.degree or 0),
        tried=request.quality != "draft" and overrides == Overrides(),
    )
    at_most = request.early_stop or (budget is not None and budget.unit == "dB")
    cores = thread_count()
    if work.clock_seconds(cores)[1] < WORTH_SAYING:
        return None
    return work.in_words(cores, at_most, free_share(cores))


def words(seconds: float) -> str:
    """Format about that many seconds: `40 s`, `5 min`, `2 h 10 min`."""
    if seconds < 90:
        return f"{max(round(seconds / 5) * 5, 5)} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
