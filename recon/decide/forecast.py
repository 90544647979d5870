"""Forecast of a training's demand on a machine, made before it begins, or when it has read its first
views.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from imaging.compute import memory
from recon.data.dataset import View
from recon.data.load import load
from recon.decide.memory_need import ARENA, Need, need
from recon.decide.presets import QUALITIES
from recon.decide.request import TrainingRequest
from recon.scene.harmonics import DEGREE

Counts = Mapping[str, tuple[int, int]]
"""Number of views of each camera in all, and to train on."""


def fitting(
    firsts: Sequence[View],
    counts: Counts,
    free: int,
    request: TrainingRequest,
) -> tuple[Need, bool]:
    """Return the demand of a training where `free` bytes are left, and whether its images stay on the disk
    for that.

    firsts: a view of each camera.
    """
    overrides = request.overrides
    asked = None if request.budget is None else request.budget.gaussians
    trained = sum(train for _, train in counts.values())
    most = asked or overrides.gaussians or QUALITIES[request.quality].gaussians_of(trained)
    degree = DEGREE if overrides.degree is None else overrides.degree
    needed = need(firsts, counts, most, degree)
    if stored := needed.too_large(free):
        needed = need(firsts, counts, most, degree, stored=True)
    return needed, stored


class _Read(Exception):
    """A view of each camera was read, which is enough."""


def forecast(
    session: Path,
    room: int,
    threads: int,
    request: TrainingRequest,
) -> int:
    """Forecast the peak bytes of a training, where a process of that many threads may take `room` in all.

    Reads a view of each camera. InputError, with the setting that would fit, where it takes more.
    """
    looks: list[tuple[Sequence[View], Counts]] = []

    def look(firsts: Sequence[View], counts: Counts) -> NoReturn:
        looks.append((tuple(firsts), counts))
        raise _Read

    with suppress(_Read):
        width = request.overrides.width or QUALITIES[request.quality].width
        load(session, max_width=width, examine=look)
    firsts, counts = looks[0]
    free = max(room - memory.resident() - ARENA * threads, 0)
    needed, _ = fitting(firsts, counts, free, request)
    needed.require(session, free)
    return needed.total
