"""What is known about exposure and response before any pose is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib import exposures, response
from calib.codes import Samples, patches, sample
from calib.track_codes import sample_tracks
from calib.views import Progress, View
from imaging.calibration import Response
from imaging.photo import read_photo
from imaging.ratios import Linearity
from imaging.records import Rung
from imaging.session import Session
from imaging.shutter import exact_times

SITES = 4_000
"""Patches that the response of one camera model is measured from; more would only take time."""
LINEAR = 0.01
"""Departure from a straight line, relative, that still counts as linear."""


@dataclass(frozen=True)
class Light:
    """scale: k of each shot's file, s; responses: by camera name; measured: whether overlaps told any."""

    scale: dict[str, float]
    responses: dict[str, Response]
    rungs: tuple[Rung, ...]
    measured: bool


def measure(session: Session, views: Sequence[View], progress: Progress) -> Light:
    """Exposures and responses of every camera, from overlapping exposures where there are any."""
    scale = exposures.labelled(views)
    responses: dict[str, Response] = {}
    rungs: list[Rung] = []
    measured = False
    raw = [view for view in views if view.camera.kind == "raw"]
    if raw:
        found = exposures.estimate(session, raw, progress)
        scale |= found.scale
        for name in {view.camera.name for view in raw}:
            responses[name] = _linear(found.linearity.get(name))
        rungs += [*found.rungs, _straight(list(found.linearity.values()))]
        measured = found.measured
    for view in views:
        if view.camera.kind == "hdr":
            responses[view.camera.name] = Response(kind="linear", evidence="EXR, taken as linear radiance")
            scale |= {shot.file: 1.0 for shot in view.shots}
    for members in _models(views):
        labels = _labels(members, scale)
        estimate = response.estimate(_samples(session, members, labels, progress))
        rungs += estimate.rungs
        measured = measured or estimate.response.residual is not None
        responses |= {view.camera.name: estimate.response for view in members}
        for file, label in labels.items():
            shift = estimate.shift.get(round(float(np.log(label)), 6), 0.0)
            scale[file] = label * float(np.exp(shift))
    return Light(scale, responses, tuple(rungs), measured)


def _linear(line: Linearity | None) -> Response:
    if line is None:
        return Response(
            kind="linear", evidence="RAW, taken as linear and not checked: no two exposures overlap"
        )
    return Response(
        kind="linear",
        evidence=f"RAW: overlapping exposures agree with a straight line to {100 * line.deviation:.2f} % "
        "from 5 to 90 % of white",
        residual=line.raw,
    )


def _straight(lines: Sequence[Linearity]) -> Rung:
    """Why RAW got no response curve."""
    if not lines:
        return Rung(
            name="response_curve", taken=False, reason="RAW is linear; no two exposures overlap to check it"
        )
    worst = max(line.deviation for line in lines)
    verdict = (
        "RAW is linear"
        if worst <= LINEAR
        else f"RAW is kept linear although it departs by more than {100 * LINEAR:g} %: "
        "check black level, white level and the light"
    )
    return Rung(
        name="response_curve", taken=False, gain=100 * worst, unit="% off a straight line", reason=verdict
    )


def _models(views: Sequence[View]) -> list[list[View]]:
    """Views of cameras that develop their photographs, by make and model: such cameras share a response."""
    groups: dict[tuple[str, ...], list[View]] = {}
    for view in views:
        camera = view.camera
        if camera.kind == "ldr":
            known = camera.make or camera.model
            groups.setdefault((camera.make, camera.model) if known else (camera.name,), []).append(view)
    return list(groups.values())


def _labels(views: Sequence[View], scale: dict[str, float]) -> dict[str, float]:
    """Exposure scale of each file by its label, a shutter's round numbers taken for what they stand for."""
    shots = [shot for view in views for shot in view.shots]
    stated = {shot.exposure.time for shot in shots if shot.exposure is not None}
    exact = exact_times(stated)
    if exact is None:
        return {shot.file: scale[shot.file] for shot in shots}
    return {
        shot.file: scale[shot.file]
        if shot.exposure is None
        else shot.exposure.with_time(exact[shot.exposure.time]).scale
        for shot in shots
    }


def _samples(
    session: Session, views: Sequence[View], labels: dict[str, float], progress: Progress
) -> Samples | None:
    """Photosites in several exposures; where no view has any, scene points that views share."""
    views = _trained_on(session, views)
    usable = [
        view
        for view in views
        if len({labels[shot.file] for shot in view.shots}) >= 2
        and all(shot.exposure is not None for shot in view.shots)
    ]
    if not usable:
        return sample_tracks(session, views, labels, progress)
    parts = []
    for done, view in enumerate(usable):
        progress("sampling the response", done, len(usable))
        cut = [patches(read_photo(session.file(shot)).pixels) for shot in view.shots]
        logs = np.log([labels[shot.file] for shot in view.shots])
        parts.append(sample(cut, logs, max(SITES // len(usable), 200)))
    return Samples.joined(parts)


def _trained_on(session: Session, views: Sequence[View]) -> list[View]:
    """The views and shots that a data set does not hold back for testing."""
    split = session.split()
    if split is None:
        return list(views)
    held_back = set(split.test)
    kept = [
        replace(view, shots=tuple(shot for shot in view.shots if shot.file not in held_back))
        for view in views
    ]
    return [view for view in kept if view.shots]
