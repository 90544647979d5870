"""Warnings about the pictures of a session, a sentence for each."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from statistics import median
from typing import TypeVar

from capture.check.examine import COMPARED, label
from capture.check.findings import Problem, ProblemKind, ShotLook
from imaging.session.records import CameraRecord

OFF_STOPS, OFF_SIGMA = 0.05, 3.0
"""A label is doubted beyond both."""
SOFT = 0.6
"""Sharpness against that of like pictures below which one is blurred: a blur of a pixel or more."""
FEWEST_FRAMES = 3
SHIFTED, SHIFT_SIGMA = 0.5, 5.0
"""Pixels between exposures of a bracket, and standard errors, beyond which they do not fit."""
MOVED = {"raw": 0.005, "hdr": 0.005, "ldr": 0.01}
"""Share of the picture that moved; development hides some, and makes up some."""
LIGHT_IN_DARK = 0.01
"""Share of the photosites of a dark frame that may be lit, or hot."""
CLIPPED_IN_FLAT = 0.001
CLIPPED_IN_SHORTEST = 0.005
"""Share of the samples of the shortest exposures above which highlights are lost."""
ALIKE = 1.3
"""Exposures within this factor of the shortest count as the shortest."""

T = TypeVar("T")
Looks = Sequence[ShotLook]


def warnings(looks: Looks, cameras: Sequence[CameraRecord]) -> Iterator[Problem]:
    """All of them: of darks and flats, of highlights, of labels, of focus, of motion."""
    yield from _darks_and_flats(looks)
    yield from _clipped(looks)
    compared = [look for look in looks if look.kind in COMPARED]
    yield from _labels(compared)
    blurred = list(_blurred(compared))
    yield from blurred
    yield from _soft_cameras(compared, cameras)
    # What is blurred in one exposure differs from the others without having moved.
    blurred_frames = {(problem.camera, problem.frame) for problem in blurred}
    yield from _moved([look for look in compared if (look.camera, look.frame) not in blurred_frames])


def lost_highlights(shots: Sequence[tuple[float, float]]) -> str | None:
    """Return what to say of highlights that not even the shortest exposures hold; None if they hold them.

    shots: exposure scale and share of clipped samples of each shot of a scene.
    """
    if not shots:
        return None
    least = min(scale for scale, _ in shots)
    share = median(clipped for scale, clipped in shots if scale <= least * ALIKE)
    if share <= CLIPPED_IN_SHORTEST:
        return None
    percent = f"{100 * share:.0f}" if share >= 0.1 else f"{100 * share:.2g}"
    return (
        f"The shortest exposure still clips {percent} % of its samples: "
        "add a shorter one to keep the highlights."
    )


def _clipped(looks: Looks) -> Iterator[Problem]:
    shots = [
        (exposure.scale, _share(look))
        for look in looks
        if look.kind == "scene" and (exposure := label(look)) is not None
    ]
    message = lost_highlights(shots)
    if message is not None:
        yield Problem(kind="clipped", message=message)


def _share(look: ShotLook) -> float:
    """Share of clipped samples: half of a mosaic's are green."""
    red, green, blue = look.clipped
    return (red + 2 * green + blue) / 4 if look.picture == "raw" else (red + green + blue) / 3


def _problem(kind: ProblemKind, look: ShotLook, message: str) -> Problem:
    place = {"camera": look.camera, "frame": look.frame, "step": look.step}
    return Problem.model_validate({"kind": kind, "file": look.file, "message": message} | place)


def _grouped(looks: Iterable[ShotLook], key: Callable[[ShotLook], T]) -> dict[T, list[ShotLook]]:
    groups: dict[T, list[ShotLook]] = {}
    for look in looks:
        groups.setdefault(key(look), []).append(look)
    return groups


def _darks_and_flats(looks: Looks) -> Iterator[Problem]:
    for look in looks:
        if look.kind == "dark" and look.lit > LIGHT_IN_DARK:
            yield _problem(
                "dark",
                look,
                f"{look.file} is a dark frame, and {100 * look.lit:.2g} % of it saw light: "
                "cover the lens and the viewfinder, and take the darks again.",
            )
        if look.kind == "flat" and max(look.clipped) > CLIPPED_IN_FLAT:
            worst = max(range(3), key=lambda channel: look.clipped[channel])
            yield _problem(
                "flat",
                look,
                f"{look.file} is a flat frame, and {100 * look.clipped[worst]:.2g} % of its "
                f"{('red', 'green', 'blue')[worst]} is clipped: take the flats again with less light.",
            )


def _labels(looks: Looks) -> Iterator[Problem]:
    """Exposures that are not what their labels say; one sentence for a step that is always off."""
    estimated = [look for look in looks if look.off is not None]
    for (camera, _), group in _grouped(estimated, lambda look: (look.camera, str(label(look)))).items():
        wrong = [look for look in group if doubted(look)]
        if not wrong:
            continue
        first = wrong[0]
        if len(group) > 1 and len(wrong) > len(group) / 2:
            off = median(look.off or 0.0 for look in wrong)
            middle = min(wrong, key=lambda look: abs((look.off or 0.0) - off))
            yield _problem(
                "label",
                first.model_copy(update={"file": ""}),
                f"{camera} exposed {off:+.2f} stops off its label {label(first)} in {len(wrong)} of "
                f"{len(group)} frames (estimated {middle.estimated}): run rig calibrate, which measures "
                "exposures.",
            )
            continue
        for look in wrong:
            yield _problem(
                "label",
                look,
                f"{look.file} was exposed {look.off:+.2f} stops off its label {label(look)} "
                f"(estimated {look.estimated}): run rig calibrate, which measures exposures.",
            )


def doubted(look: ShotLook) -> bool:
    """Return whether the estimate says that the label is wrong."""
    if look.off is None or look.estimate_error is None:
        return False
    return abs(look.off) > max(OFF_STOPS, OFF_SIGMA * look.estimate_error)


def _blurred(looks: Looks) -> Iterator[Problem]:
    """Shots that are less sharp than the rest of their bracket, or than the same step in other frames."""
    usual = {
        key: median(values)
        for key, group in _grouped(looks, _step).items()
        if len(values := [look.sharpness for look in group if look.sharpness is not None]) >= FEWEST_FRAMES
    }
    problems = []
    for look in looks:
        against = [look.relative_sharpness] if look.relative_sharpness is not None else []
        if look.sharpness is not None and usual.get(_step(look)):
            against.append(look.sharpness / usual[_step(look)])
        if against and min(against) < SOFT:
            problems.append((look, min(against)))
    for group in _grouped((look for look, _ in problems), lambda look: (look.camera, look.frame)).values():
        least = min(value for look, value in problems if look in group)
        files = group[0].file if len(group) == 1 else f"{len(group)} shots from {group[0].file} on"
        verb = "has" if len(group) == 1 else "have"
        yield _problem(
            "focus",
            group[0],
            f"{files} {verb} {100 * least:.0f} % of the fine detail of like pictures: "
            "look whether the camera shook or the focus was lost, and take the frame again.",
        )


def _step(look: ShotLook) -> tuple[str, str, int]:
    return look.kind, look.camera, look.step


def _soft_cameras(looks: Looks, cameras: Sequence[CameraRecord]) -> Iterator[Problem]:
    """Cameras that are less sharp in all frames than others of their make and model in the same frames.

    Other frames may show something else, at another focal length; and a picture that a camera made smaller
    has finer detail for its size.
    """
    models = {camera.name: (camera.make, camera.model, camera.kind) for camera in cameras}
    ratios: dict[str, list[float]] = {}
    sharp = [look for look in looks if look.sharpness is not None and look.camera in models]

    def like(look: ShotLook) -> tuple[object, ...]:
        return look.kind, look.step, models[look.camera], tuple(sorted((look.width, look.height)))

    for group in _grouped(sharp, like).values():
        by_camera = _grouped(group, lambda look: look.camera)
        frames = {camera: {look.frame for look in mine} for camera, mine in by_camera.items()}
        for camera, mine in by_camera.items():
            rest = [
                _sharpness(others)
                for name, others in by_camera.items()
                if name != camera and len(frames[name] & frames[camera]) >= FEWEST_FRAMES
            ]
            if rest and median(rest) > 0:
                ratios.setdefault(camera, []).append(_sharpness(mine) / median(rest))
    for camera, values in ratios.items():
        if median(values) < SOFT:
            yield Problem(
                kind="focus",
                camera=camera,
                message=f"{camera} shows {100 * median(values):.0f} % of the fine detail of other cameras of "
                "its model: look at its focus ring and its lens, and take the session again.",
            )


def _sharpness(looks: Looks) -> float:
    return median(look.sharpness for look in looks if look.sharpness is not None)


def _moved(looks: Looks) -> Iterator[Problem]:
    by_step = {(look.kind, look.camera, look.frame, look.step): look for look in looks}
    for look in by_step.values():
        if look.shift is None or look.shift_error is None or look.moved is None:
            continue
        length = (look.shift[0] ** 2 + look.shift[1] ** 2) ** 0.5
        if length > max(SHIFTED, SHIFT_SIGMA * look.shift_error):
            yield _problem(
                "motion",
                look,
                f"{look.file} is shifted by {length:.1f} pixels against the next longer exposure of its "
                "bracket: fix the camera more firmly, and take the frame again.",
            )
        if look.moved > MOVED[look.picture]:
            yield _problem(
                "motion",
                look,
                f"{100 * look.moved:.1f} % of {look.file} moved against the next longer exposure of its "
                "bracket: keep the scene still, and take the frame again.",
            )
