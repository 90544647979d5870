"""Order of trainings by information: presets, then one thing changed at a time, then neighbours of the
front.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from recon.data.dataset import Dataset
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES
from recon.trade.point import front
from recon.trade.trade_record import Choice, Point

MOST_NEIGHBOURS = 12
SAFETY = 1.2
"""Safety factor on the expected time of a training before it is begun."""


@dataclass(frozen=True)
class Session:
    """Limits of a session. width: px of its widest images. exposures: most shots of a view, of one band."""

    width: int
    views: int
    exposures: int

    @classmethod
    def of(cls, dataset: Dataset) -> "Session":
        """Read the limits of the data set as it is measured with."""
        return cls(
            width=max(view.lens.width for view in dataset.views),
            views=len(dataset.train),
            exposures=max(
                count
                for view in dataset.train
                for count in Counter(shot.band for shot in view.shots).values()
            ),
        )

    def effective(self, choice: Choice) -> Overrides:
        """All that is set by a choice and its preset: equal for choices that train the same."""
        preset, overrides = QUALITIES[choice.quality], choice.overrides
        return overrides.model_copy(
            update={
                "iterations": overrides.iterations or preset.iterations_of(self.views),
                "gaussians": overrides.gaussians or preset.gaussians_of(self.views),
                "width": min(overrides.width or preset.width, self.width),
            }
        )

    def trained(self, point: Point) -> Overrides:
        """The same of a finished training, with what was decided by the scene."""
        return self.effective(point.choice).model_copy(update=_decided(point))

    def work(self, choice: Choice) -> float:
        """Return what a training costs, in units that only compare trainings of this session."""
        all_of_it = self.effective(choice)
        iterations, gaussians, width = (
            all_of_it.iterations or 0,
            all_of_it.gaussians or 0,
            all_of_it.width or 0,
        )
        shots = min(all_of_it.exposures or self.exposures, self.exposures)
        # Measured on the demo rig (bench/recon/budget.py): 20,000 Gaussians cost about as much as 320 x 240
        # pixels.
        return iterations * (0.75 * width**2 * (0.5 + 0.5 * shots / self.exposures) + 4.0 * gaussians)


STANDARD = Choice(axis="preset", quality="standard")


def planned(session: Session, trained: Point | None) -> list[Choice]:
    """Presets and single changes of `standard`, the most informative first; without duplicates.

    trained: `standard`, whose size and corrections were chosen by the scene: the others take them over, so
    that one thing alone changes. None: it could not be trained.
    """
    standard = QUALITIES["standard"]
    iterations = standard.iterations_of(session.views)
    count = standard.gaussians_of(session.views) if trained is None else trained.gaussians
    decided = {} if trained is None else _decided(trained)
    width = min(standard.width, session.width)
    wanted: list[tuple[str, dict[str, Any]]] = [
        ("iterations", {"iterations": iterations // 2}),
        ("Gaussians", {"gaussians": count // 2}),
        ("Gaussians", {"gaussians": 2 * count}),
        ("resolution", {"width": width // 2}),
        ("exposures", {"exposures": 1}),
        ("iterations", {"iterations": iterations // 4}),
        *((("corrections", {"refine": "none"}),) if decided.get("refine") else ()),
        ("SH degree", {"degree": 0}),
        ("views", {"views": session.views // 2}),
        ("iterations", {"iterations": 2 * iterations}),
        ("loss", {"ssim": 0.2}),
        ("growth", {"growth": 0.0}),
        ("SH degree", {"degree": 1}),
        ("SH degree", {"degree": 2}),
        ("exposures", {"exposures": (session.exposures + 1) // 2}),
        ("Gaussians", {"gaussians": count // 4}),
        ("resolution", {"width": width // 4}),
        ("loss", {"ssim": 0.0}),
        ("growth", {"growth": 0.75}),
        ("views", {"views": session.views // 4}),
        ("loss", {"ssim": 0.8}),
    ]
    choices = [STANDARD, *(Choice(axis="preset", quality=quality) for quality in ("draft", "best"))]
    for axis, change in wanted:
        possible = (
            change.get("width", 16) >= 16
            and change.get("gaussians", 1) >= 1
            and 3 <= change.get("views", 3) <= max(session.views - 1, 3)
            and change.get("exposures", 0) < session.exposures
        )
        if possible:
            choices.append(Choice(axis=axis, overrides=Overrides.model_validate(decided | change)))
    return distinct(choices, session, set() if trained is None else {session.trained(trained)})


def _decided(point: Point) -> dict[str, Any]:
    """Return what the scene decided of a training, as it would be set."""
    return {"gaussians": point.gaussians, "degree": point.degree, "refine": point.refine}


def distinct(choices: Sequence[Choice], session: Session, trained_before: set[Overrides]) -> list[Choice]:
    """The settings without those that would repeat `known`, or one before them."""
    choices_left, trained = [], set(trained_before)
    for choice in choices:
        same = session.effective(choice)
        if same not in trained:
            trained.add(same)
            choices_left.append(choice)
    return choices_left


def neighbours(points: Sequence[Point], session: Session) -> Iterator[Choice]:
    """Choices one step of two away from the front over time, the cheapest first, not trained yet."""
    known = {session.trained(point) for point in points}
    steps = []
    for point in front(points, lambda other: other.seconds, lambda other: other.db):
        here = session.trained(point)
        for key, factor in (
            ("gaussians", 2.0), ("iterations", 2.0), ("width", 0.5), ("gaussians", 0.5), ("iterations", 0.5)
        ):  # fmt: skip
            value = int(getattr(here, key) * factor)
            if value >= 16 and not (key == "width" and value > session.width):
                overrides = here.model_copy(update={key: value})
                steps.append(Choice(axis="near the front", overrides=overrides))
    longest = max((session.work(point.choice) for point in points), default=0.0)
    fitting = [choice for choice in steps if session.work(choice) <= longest]
    yield from sorted(distinct(fitting, session, known), key=session.work)[:MOST_NEIGHBOURS]


def expected_seconds(choice: Choice, points: Sequence[Point], session: Session) -> float | None:
    """Expected seconds of a training, by the two finished ones whose work is nearest; None without any.

    The straight line through them knows that each begins with a look at the scene, which takes its time
    however short the training is. With a single one time grows as the work does.
    """
    work = session.work(_as_sized(choice, points, session))
    done = {session.work(_with_count(point.choice, point.gaussians)): point.seconds for point in points}
    near = sorted(done, key=lambda other: abs(math.log(other / work)))[:2]
    if not near:
        return None
    if len(near) == 1:
        return SAFETY * done[near[0]] * work / near[0]
    slope = max((done[near[1]] - done[near[0]]) / (near[1] - near[0]), 0.0)
    return SAFETY * max(done[near[0]] + slope * (work - near[0]), 0.0)


def _as_sized(choice: Choice, points: Sequence[Point], session: Session) -> Choice:
    """Limit the Gaussians to the number that the scene needed before, where that is fewer."""
    if choice.overrides.gaussians is not None:
        return choice
    needed = [
        point.gaussians
        for point in points
        if point.choice.overrides.gaussians is None
        and point.gaussians < (session.effective(point.choice).gaussians or 0)
    ]
    most = session.effective(choice).gaussians or 0
    return _with_count(choice, min(most, max(needed, default=most)))


def _with_count(choice: Choice, gaussians: int) -> Choice:
    return choice.model_copy(
        update={"overrides": choice.overrides.model_copy(update={"gaussians": gaussians})}
    )
