"""Exposures and responses, which need no pose."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from calib.data.views import View
from calib.light import exposure_scales
from calib.light.curves import response
from calib.light.curves.codes import Patches, Samples, patches, sample
from calib.light.curves.track_codes import sample_tracks
from imaging.arrays import Array
from imaging.files.photo import read_photo
from imaging.merge.linear_frame import decode
from imaging.merge.masks import mask_of
from imaging.merge.ratios import LABEL_SIGMA, Linearity
from imaging.optics.dial_settings import meant
from imaging.progress import Progress
from imaging.session.calibration import RAW_CURVE, CalibrationRecord, Response
from imaging.session.records import Rung, ShotRecord
from imaging.session.session import Session

SITES = 4_000
"""Patches that the response of one camera model is measured from; more would only take time."""
LIGHT_RUNGS = frozenset({*response.RUNGS, "exposure_ratios", "exposure_per_shot", RAW_CURVE})
CURVES = "gamma, lookup table, tone curve and contrast"
LINEAR = 0.01
"""Departure from a straight line, relative, that still counts as linear."""
WRONG = 0.25
"""Departure from a label, natural log, that no shutter has: the label is another photograph's."""
FEWEST_CODES = 60
"""Codes that two photographs must share to be compared."""
LEAST_SCATTER, SCATTERED = 0.02, 0.35
"""Median scatter of a ratio, natural log, below which it counts as this, and above which it says nothing:
neighbouring exposures of published brackets scatter by less than 0.2, those without light in range of both by
0.7 and more."""


@dataclass(frozen=True)
class Radiometry:
    """Result. scale: k of each shot's file, s; responses: by camera name; measured: whether from overlaps."""

    scale: dict[str, float]
    responses: dict[str, Response]
    rungs: tuple[Rung, ...]
    measured: bool


def measure_light(session: Session, views: Sequence[View], progress: Progress) -> Radiometry:
    """Exposures and responses of every camera, from overlapping exposures where there are any."""
    scale = exposure_scales.labelled(views)
    responses: dict[str, Response] = {}
    rungs: list[Rung] = []
    measured = False
    raw = [view for view in views if view.camera.kind == "raw"]
    if raw:
        estimated = exposure_scales.estimate(session, raw, progress)
        scale |= estimated.scale
        for name in {view.camera.name for view in raw}:
            responses[name] = _linear(estimated.linearity.get(name), estimated.powers.get(name))
        rungs += [*estimated.rungs, _straight(estimated.linearity), *_left_on(estimated.powers)]
        measured = estimated.measured
    for view in views:
        if view.camera.kind == "hdr":
            responses[view.camera.name] = Response(kind="linear", evidence="EXR, taken as linear radiance")
            scale |= {shot.file: 1.0 for shot in view.shots}
    for members in _models(views):
        labels = _labels(members, scale)
        estimate, labels = _developed(session, members, labels, progress)
        rungs += estimate.rungs
        measured = measured or estimate.response.residual is not None
        responses |= {view.camera.name: estimate.response for view in members}
        for file, label in labels.items():
            shift = estimate.shift.get(round(float(np.log(label)), 6), 0.0)
            scale[file] = label * float(np.exp(shift))
    return Radiometry(scale, responses, tuple(rungs), measured)


def light_of(record: CalibrationRecord, views: Sequence[View]) -> Radiometry:
    """Read exposures and responses of an earlier calibration, for one that measures other parts again.

    The factors of single photographs are left out: they need poses.
    """
    scale, developed = dict(record.exposure_scale), {view.id: view.exposure for view in record.views}
    for view in views:
        for shot in view.shots:
            if shot.file in scale:
                scale[shot.file] /= developed.get(view.id, 1.0)
    return Radiometry(
        scale=scale,
        responses={camera.name: camera.response for camera in record.cameras},
        rungs=tuple(rung for rung in record.rungs if rung.name in LIGHT_RUNGS),
        measured=False,
    )


def _linear(line: Linearity | None, power: float | None) -> Response:
    if power is not None:
        return Response(
            kind="linear",
            evidence=f"RAW, kept linear although its signal goes with light to the power {power:.2f}",
            residual=None if line is None else line.raw,
        )
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


def _straight(lines: Mapping[str, Linearity]) -> Rung:
    """Return why RAW got no response curve. lines: of each camera, by name."""
    if not lines:
        return Rung(
            name="response_curve", taken=False, reason="RAW is linear; no two exposures overlap to check it"
        )
    name, worst = max(lines.items(), key=lambda one: one[1].deviation)
    verdict = (
        "RAW is linear"
        if worst.deviation <= LINEAR
        else f"RAW is kept linear although that of {name} departs by more than {100 * LINEAR:g} %: "
        f"switch off {CURVES} in the camera, and check black level, white level and the light"
    )
    return Rung(
        name="response_curve",
        taken=False,
        gain=100 * worst.deviation,
        unit="% off a straight line",
        reason=verdict,
    )


def _left_on(powers: Mapping[str, float]) -> list[Rung]:
    """A doubt where cameras bent their RAW. powers: of light that it goes with, by their names."""
    if not powers:
        return []
    named = ", ".join(f"{name} (light to the power {power:.2f})" for name, power in sorted(powers.items()))
    return [
        Rung(
            name=RAW_CURVE,
            taken=True,
            reason=f"the RAW of {named} is not linear, as with a gamma in the camera, if the exposure times "
            f"are right: switch off {CURVES} in the camera and shoot again, or correct the exposure times if "
            "those are wrong",
        )
    ]


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
    """Exposure scale of each file by its label, a dial's nominal values replaced by exact ones."""
    shots = [shot for view in views for shot in view.shots]
    exact = meant(shot.exposure for shot in shots if shot.exposure is not None)
    return {
        shot.file: scale[shot.file] if shot.exposure is None else exact[shot.exposure].scale for shot in shots
    }


def _developed(
    session: Session, views: Sequence[View], labels: dict[str, float], progress: Progress
) -> tuple[response.Estimate, dict[str, float]]:
    """The response, and the labels; those of single photographs that the others refute are put right.

    From photosites in several exposures; where no view has any, from scene points that views share.
    """
    views = _trained_on(session, views)
    parts = _samples(session, views, labels, progress)
    if not parts:
        return response.estimate(sample_tracks(session, views, labels, progress)), labels
    estimate = response.estimate(Samples.joined([samples for _, samples in parts]))
    if len(parts) < 2 or estimate.response.residual is None:
        return estimate, labels
    right, corrections, corrected = dict(labels), [], []
    for view, samples in parts:
        log_k = samples.log_k.copy()
        for column, away in enumerate(_departures(samples, estimate.response, estimate.shift).tolist()):
            if abs(away) > WRONG:
                file = view.shots[column].file
                label = _nearest(labels[file] * float(np.exp(away)), list(labels.values()))
                log_k[:, column], right[file] = np.log(label), label
                corrections.append(f"the exposure of {file} is {label / labels[file]:.2g} times its label")
        corrected.append(replace(samples, log_k=log_k))
    if not corrections:
        return estimate, labels
    estimate = response.estimate(Samples.joined(corrected))
    rung = Rung(name="exposure_of_a_file", taken=True, reason="; ".join(corrections))
    return replace(estimate, rungs=(*estimate.rungs, rung)), right


def _nearest(scale: float, labels: Sequence[float]) -> float:
    """The exact label of a scale, if there is one within a tenth; else the scale itself."""
    nearest = min(labels, key=lambda label: abs(np.log(label / scale)))
    return nearest if abs(np.log(nearest / scale)) < 0.1 else scale


def _samples(
    session: Session, views: Sequence[View], labels: dict[str, float], progress: Progress
) -> list[tuple[View, Samples]]:
    """Photosites of every view that has two exposures or more."""
    usable = [
        view
        for view in views
        if len({labels[shot.file] for shot in view.shots}) >= 2
        and all(shot.exposure is not None for shot in view.shots)
    ]
    parts = []
    for done, view in enumerate(usable):
        progress("sampling the response", done, len(usable))
        cut = [_patches(session, shot) for shot in view.shots]
        logs = np.log([labels[shot.file] for shot in view.shots])
        parts.append((view, sample(cut, logs, max(SITES // len(usable), 200))))
    return parts


def _patches(session: Session, shot: ShotRecord) -> Patches:
    pixels = read_photo(session.file(shot)).pixels
    return patches(pixels, mask_of(session, shot, *pixels.shape[:2]))


def _trained_on(session: Session, views: Sequence[View]) -> list[View]:
    """The views and shots that a data set is trained on; the rest is for testing, or for nothing."""
    split = session.split()
    if split is None:
        return list(views)
    used = set(split.train)
    trained = [replace(view, shots=tuple(shot for shot in view.shots if shot.file in used)) for view in views]
    return [view for view in trained if view.shots]


def _departures(samples: Samples, response: Response, shift: dict[float, float]) -> Array:
    """Natural log of the exposure over label and shift, [S], of each photograph of one view.

    Most of a view's photographs are taken to be right. NaN if undecidable: of two photographs that contradict
    each other, and of those that share too few codes with the others.
    """
    departed = np.full(samples.codes.shape[1], np.nan)
    if not len(samples.codes):
        return departed
    moved = np.vectorize(lambda label: label + shift.get(round(float(label), 6), 0.0))(samples.log_k[0])
    codes = samples.codes / 255.0
    with np.errstate(divide="ignore"):
        light = np.log(decode(np.nan_to_num(codes, nan=0.5), response).astype(np.float64))
    light = np.where(np.isfinite(codes), light - moved[:, None], np.nan)
    pairs, rows, goals = [], [], []
    for first in range(len(departed)):
        for second in range(first):
            away = light[:, first] - light[:, second]
            away = away[np.isfinite(away)]
            if len(away) < FEWEST_CODES:
                continue
            ratio = float(np.median(away))
            scatter = float(np.median(np.abs(away - ratio)))
            # Exposures far apart share only photosites that noise or edges bring into range of both.
            if scatter < SCATTERED:
                weight = 1.0 / max(scatter, LEAST_SCATTER)
                pairs.append((first, second))
                rows.append(weight * (np.eye(len(departed))[first] - np.eye(len(departed))[second]))
                goals.append(weight * ratio)
    if not pairs:
        return departed
    graph = sparse.csr_array((np.ones(len(pairs)), np.array(pairs).T), (len(departed), len(departed)))
    part = connected_components(graph, directed=False)[1]
    together = part == np.bincount(part).argmax()
    if together.sum() < 3:
        return departed
    offset = np.linalg.lstsq(np.array(rows), np.array(goals))[0]
    from_each = offset[together][None] - offset[together][:, None]
    departed[together] = from_each[np.argmin(np.log1p((from_each / LABEL_SIGMA) ** 2).sum(1))]
    return departed
