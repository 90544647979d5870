"""The most memory that a training takes, by one view of each camera: before it begins, and as it begins."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from pathlib import Path
from typing import NoReturn

from imaging.compute import memory
from imaging.compute.threads import thread_count
from imaging.errors import InputError
from recon.data.dataset import View
from recon.data.load import load
from recon.data.resident import FLOAT, decoded_bytes, pixels_of
from recon.data.shot import bytes_of
from recon.decide.presets import QUALITIES
from recon.decide.request import TrainingRequest
from recon.scene.harmonics import DEGREE

KERNELS = 110_000_000
"""Bytes of compiled kernels, of libraries that are loaded on the way, and of writing the scene."""
NUMBERS = 14, 9, 15
"""Numbers of a Gaussian: those of degree 0, and the additional ones of degrees 1 and 2."""
ADAM = 4
"""Each number with its gradient and the two averages of Adam."""
TABLES = 1220
"""Bytes of a Gaussian in the tables of a render and its gradient, and as a point at the start: between the
peaks of three sets of photographs (`bench/real/memory.py`)."""
PICTURE = 250
"""Bytes of a pixel of the largest view beside `step_bytes`: of its evaluation, and what the C library keeps;
between those of a castle 1,280 px wide and a telephone's video at 640 (`bench/real/memory.py`).
"""
MOST_IMAGES = 0.5
"""Share of the free memory that images and all arrays made of them may take and be held there."""
LOOK = 48
"""Bytes of a pixel whose shots are read and made targets at each look, beside both; by what trainings on RAW
brackets of 0.8 megapixels took (6 views and 12: 0.88 and 0.98 GB where 0.87 was said without)."""
DEPTH = 48
"""Bytes of a pixel whose depth is read, drawn and compared with."""
ARENA = 64 << 20
"""Bytes of address space that the C library sets aside for a thread."""
Counts = Mapping[str, tuple[int, int]]
"""Number of views of each camera in all, and to train on."""


@dataclass(frozen=True)
class Need:
    """Bytes at the peak: of the process itself, of images that are `width` px wide, and of the Gaussians."""

    process: int
    images: int
    gaussians: int
    width: int
    count: int
    held: int = 0
    """Bytes of the images that are in memory already."""
    budgeted: bool = False
    """True if a budget in bytes or Gaussians gives `count`."""

    @property
    def total(self) -> int:
        """All of it."""
        return self.process + self.images + self.gaussians

    def too_large(self, free: int) -> bool:
        """Return whether images that are held in memory leave too little of the `free` bytes for the rest."""
        more = self.images - self.held + self.gaussians + KERNELS
        return self.images > MOST_IMAGES * free or more > free

    def worth_saying(self, free: int) -> bool:
        """Return whether it takes more than a quarter of the `free` bytes."""
        return 4 * (self.images + self.gaussians) > free

    def in_words(self) -> str:
        """A line that says what takes how much."""
        images, gaussians = memory.text(self.images), memory.text(self.gaussians)
        return f"memory: about {memory.text(self.total)}, {images} for images, {gaussians} for Gaussians"

    def require(self, session: object, free: int) -> None:
        """InputError, with the setting that would fit, unless `free` bytes are enough for what is to come."""
        if (more := self.images - self.held + self.gaussians + KERNELS) <= free:
            return
        room = free + self.held - KERNELS
        width = 0
        if room > self.gaussians:
            width = int(0.95 * self.width * math.sqrt((room - self.gaussians) / self.images)) // 8 * 8
        count = int(0.98 * self.count * (room - self.images) / self.gaussians) // 1000 * 1000
        if count >= self.count / 4:
            fix = f"give --budget {count // 1000}k" if self.budgeted else f"give --set gaussians={count}"
        elif width >= 32:
            fix = f"give --set width={width}"
        else:
            fix = "use a machine with more memory"
        raise InputError(
            f"Training on {session} takes {memory.text(more)} more of memory where {memory.text(free)} are "
            f"free: {fix}."
        )


def free() -> int:
    """Bytes that a training may take, less the address space that its threads set aside."""
    return max(memory.available() - ARENA * thread_count(), 0)


def need(
    firsts: Sequence[View],
    counts: Counts,
    gaussians: int,
    degree: int,
    *,
    used: Sequence[View] | None = None,
    stored: bool = False,
) -> Need:
    """Peak memory of a training.

    Of shots in memory the peak is either where the start has the light of all views beside them, or where
    training has come to hold the targets of all of them. Of shots on the disk one view at a time has its
    shots, its light or its targets in memory.

    Args:
        firsts: A view of each camera.
        counts: Number of views of each camera in all, and to train on.
        gaussians: Most Gaussians of the training.
        degree: Of the harmonics, 0..2.
        used: The same views with the exposures that are trained on; None: with all that are read.
        stored: True if the shots are on the disk.

    Returns:
        Bytes, by what takes them.
    """
    used = firsts if used is None else used
    shots = sum(_number(counts, view, 0, stored) * decoded_bytes(view) for view in firsts)
    start = sum(_number(counts, view, 1, stored) * _light(view) for view in firsts)
    targets = sum(_number(counts, view, 1, stored) * _targets(view) for view in used)
    targets += max(step_bytes(view) + PICTURE * pixels_of(view) for view in used)
    if stored:
        targets += max(LOOK * pixels_of(view) for view in firsts)
    return Need(
        process=memory.resident() + KERNELS,
        images=shots + max(start, targets),
        gaussians=gaussians * bytes_of_gaussian(degree),
        width=max(view.lens.width for view in firsts),
        count=gaussians,
        held=sum(map(decoded_bytes, firsts)),
    )


def bytes_of_gaussian(degree: int) -> int:
    """Bytes of a Gaussian in a training."""
    return FLOAT * ADAM * sum(NUMBERS[: degree + 1]) + TABLES


def _number(counts: Counts, view: View, which: int, stored: bool) -> int:
    return min(counts[view.camera][which], 1) if stored else counts[view.camera][which]


def _light(view: View) -> int:
    """Bytes of its radiance and of where that is trusted, and of the share of a percentile of them all."""
    return pixels_of(view) * (FLOAT * view.channels + 1 + 2 * FLOAT)


def _targets(view: View) -> int:
    """Bytes of what a training compares with: codes or light, masks, weights and depth."""
    masks = sum(bytes_of(shot.saturated) + bytes_of(shot.dark) + bytes_of(shot.valid) for shot in view.shots)
    pixels = sum(math.prod(shot.shape) for shot in view.shots)
    weights = FLOAT * 3 * pixels_of(view) if view.sensor.kind == "ldr" and len(view.shots) > 1 else 0
    depth = (FLOAT + 1) * pixels_of(view) if view.depth is not None else 0
    return FLOAT * pixels + masks + weights + depth


def step_bytes(view: View) -> int:
    """Return the bytes of a render, of its comparison with all shots, and of the gradients of both."""
    depth = DEPTH * pixels_of(view) if view.depth is not None else 0
    return FLOAT * (8 * sum(math.prod(shot.shape) for shot in view.shots) + 16 * pixels_of(view)) + depth


def fitting(
    firsts: Sequence[View],
    counts: Counts,
    free: int,
    request: TrainingRequest,
) -> tuple[Need, bool]:
    """Return the demand of a training, and whether its images stay on the disk to leave room.

    Args:
        firsts: A view of each camera.
        counts: Number of views of each camera in all, and to train on.
        free: Bytes that the training may take.
        request: Of the training; its budget, overrides and preset give the number of Gaussians, and the
            degree.

    Returns:
        The demand, and True if the images have to stay on the disk.
    """
    asked = request.overrides.degree
    degrees = range(DEGREE + 1) if asked is None else (asked,)
    # All shots are read before views and exposures are chosen.
    counts = in_use(counts, request.overrides.views)
    used = tuple(map(request.overrides.bracket, firsts))
    trained = sum(train for _, train in counts.values())
    pixels = trained_pixels(firsts, counts)
    # In Gaussians of the highest degree: a file of some bytes holds more of a lower one.
    highest = bytes_of_gaussian(degrees[-1])
    most = max(
        request.most_gaussians(trained, pixels, degree) * bytes_of_gaussian(degree) // highest
        for degree in degrees
    )
    needed = need(firsts, counts, most, degrees[-1], used=used)
    if stored := needed.too_large(free):
        needed = need(firsts, counts, most, degrees[-1], used=used, stored=True)
    budgeted = request.budget is not None and request.budget.gaussians is not None
    return replace(needed, budgeted=budgeted), stored


def in_use(counts: Counts, views: int | None) -> Counts:
    """Return the counts of a training on that many views, shared in proportion between the cameras; None:
    on all.
    """
    trained = sum(train for _, train in counts.values())
    if views is None or views >= trained:
        return counts
    ends = accumulate((train for _, train in counts.values()), initial=0)
    shares = [views * end // trained for end in ends]
    return {
        camera: (count, end - start)
        for (camera, (count, _)), (start, end) in zip(counts.items(), pairwise(shares), strict=True)
    }


def trained_pixels(firsts: Sequence[View], counts: Counts) -> int:
    """Pixels of all training views together; firsts: a view of each camera."""
    return sum(counts[view.camera][1] * pixels_of(view) for view in firsts)


class _Read(Exception):
    """A view of each camera was read, which is enough."""


def forecast(
    session: Path,
    room: int,
    threads: int,
    request: TrainingRequest,
) -> int:
    """Forecast the peak memory of a training from a view of each camera, which it reads.

    Args:
        session: Folder of a calibrated session.
        room: Bytes that the process may take in all.
        threads: Of the process; each sets `ARENA` bytes of address space aside.
        request: Of the training.

    Returns:
        Bytes at the peak.

    Raises:
        InputError: It takes more, with the setting that would fit; or files are missing or damaged.
        ReconstructionError: The session cannot be trained on, as by `recon.data.load.load`.
    """
    looks: list[tuple[Sequence[View], Counts]] = []

    def look(firsts: Sequence[View], counts: Counts) -> NoReturn:
        looks.append((tuple(firsts), counts))
        raise _Read

    with suppress(_Read):
        width = request.overrides.width or QUALITIES[request.quality].width
        load(session, max_width=width, all_views=request.all_views, examine=look)
    firsts, counts = looks[0]
    free = max(room - memory.resident() - ARENA * threads, 0)
    needed, _ = fitting(firsts, counts, free, request)
    needed.require(session, free)
    return needed.total
