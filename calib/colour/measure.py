"""The colours of a session's cameras from a chart that their views show.

Searched only when asked for: a search takes time, and a poster or a keyboard may look like a chart.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from calib.colour.chart_detection import NO_FALLOFF, DetectedChart, Missed, best, locate
from calib.colour.chart_values import EDITION, chart
from calib.colour.fit import ChartPatches, ColourModel, fit, held_out, of_camera
from calib.colour.white_balance import triple
from calib.data.views import View, read_view
from calib.light.radiometry import Radiometry
from calib.sensor.metadata import CameraSensor
from imaging.and_list import and_list
from imaging.arrays import Array
from imaging.colour.spaces import balanced, with_rgb
from imaging.errors import CalibrationError
from imaging.merge.bracket import merge_bracket
from imaging.merge.linear_frame import read_linear
from imaging.progress import Progress
from imaging.sensor.cfa import cell_means
from imaging.sensor.mosaic import Matrix, as_matrix
from imaging.session.calibration import CalibrationRecord
from imaging.session.calibration_evidence import ChartEvidence, ChartPatch
from imaging.session.records import Rung
from imaging.session.session import Session

SEARCHED = 6
"""Views of each camera, the first and the last among them: searching all would take minutes."""
UNIT = "delta E 2000 per held-out patch"

T = TypeVar("T")


@dataclass(frozen=True)
class Charts:
    """Results of the charts: camera_from_rec709 and evidence by camera name, and the rungs."""

    matrices: dict[str, Matrix] = field(default_factory=dict)
    evidence: dict[str, ChartEvidence] = field(default_factory=dict)
    rungs: tuple[Rung, ...] = ()

    def applied(self, sensors: Mapping[str, CameraSensor]) -> dict[str, CameraSensor]:
        """The cameras with the colours that the charts gave them."""
        return {
            name: replace(sensor, camera_from_rec709=self.matrices.get(name, sensor.camera_from_rec709))
            for name, sensor in sensors.items()
        }


@dataclass(frozen=True)
class _Trial:
    """One candidate: cameras in groups that share a matrix, and the model of each group."""

    groups: tuple[tuple[str, ...], ...]
    models: tuple[ColourModel, ...]

    def by_camera(
        self,
        of_group: Callable[[list[ChartPatches], Array, ColourModel], list[T]],
        patches: Mapping[str, ChartPatches],
        reference: Array,
    ) -> dict[str, T]:
        """Apply `fit` or `held_out` to each group: what it gives for every camera, by name."""
        return {
            name: one
            for group, model in zip(self.groups, self.models, strict=True)
            for name, one in zip(group, of_group([patches[n] for n in group], reference, model), strict=True)
        }


def measure_charts(
    session: Session,
    views: Sequence[View],
    sensors: Mapping[str, CameraSensor],
    light: Radiometry,
    earlier: CalibrationRecord | None,
    progress: Progress,
) -> Charts:
    """Search each RAW camera's views for a chart, and fit its colours.

    Args:
        session: Session of the views.
        views: Views of the scene; those of RAW cameras are searched.
        sensors: Sensors by camera name, with the colour matrices of the files.
        light: Exposure scales and responses with which files are read.
        earlier: Calibration of the session, whose vignetting is divided out; None: only that of flats is.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Matrices of the RAW cameras that a chart determines, the evidence, and the rungs.

    Raises:
        CalibrationError: No camera is RAW, or no view that was searched shows a chart.
        InputError: A file is missing or damaged.
    """
    raw = [view for view in views if view.camera.kind == "raw"]
    if not raw:
        raise CalibrationError(
            f"{session.folder} has no RAW view of a scene, and a chart cannot calibrate developed "
            "photographs: leave --chart out."
        )
    names = list(dict.fromkeys(view.camera.name for view in raw))
    falls = {
        name: earlier.camera(name).vignetting
        if earlier is not None
        else NO_FALLOFF
        if (flat := sensors[name].measured.falloff) is None
        else flat.vignetting
        for name in names
    }
    detected: dict[str, tuple[View, DetectedChart]] = {}
    missed: list[Missed] = []
    for done, name in enumerate(names):
        progress("searching the colour chart", done, len(names))
        for view in _searched([view for view in raw if view.camera.name == name]):
            verdict = _look(session, view, falls[name], light)
            if isinstance(verdict, DetectedChart):
                detected[name] = (view, verdict)
                break
            missed.append(verdict)
    progress("searching the colour chart", len(names), len(names))
    if not detected:
        worst = next((one for one in missed if one.near), missed[0])
        raise CalibrationError(
            f"{session.folder}: no colour chart found (views searched: {len(missed)}; {worst.reason}): "
            "show a classic ColorChecker, whole and evenly lit, in the first or the last frame, or leave "
            "--chart out."
        )
    models = {view.camera.name: f"{view.camera.make} {view.camera.model}" for view in raw}
    return colours(detected, {name: sensors[name].camera_from_rec709 for name in names}, models)


def _searched(views: Sequence[View]) -> Iterator[View]:
    """The first view, the last, and some evenly between."""
    places = np.unique(np.rint(np.linspace(0, len(views) - 1, SEARCHED)).astype(int))
    ends = [0, len(views) - 1]
    for place in dict.fromkeys([*ends, *places.tolist()]):
        yield views[place]


def _look(
    session: Session, view: View, vignetting: tuple[float, float, float], light: Radiometry
) -> DetectedChart | Missed:
    """Search the middle exposure, and merge the bracket only where it shows something.

    Masks hide no chart: it lies beside what is to be reconstructed, where a mask leaves it out on purpose.
    """
    shots = sorted(view.shots, key=lambda shot: light.scale[shot.file])
    middle = shots[len(shots) // 2]
    name = view.camera.name
    frame = read_linear(
        session.file(middle), "raw", light.scale[middle.file], light.responses[name], view.sensors
    )
    if frame.cfa is None:
        return Missed("its files hold demosaicked light, not mosaics")
    small = balanced(cell_means(frame.signal, frame.cfa), None)
    finds = [frame.cfa.cell * outlines for outlines in locate(small)]
    if not finds:
        return best(merge_bracket([frame]), finds)
    merged = merge_bracket(read_view(session, view, light.scale, light.responses[name]))
    return best(merged, finds, vignetting)


def colours(
    detected: Mapping[str, tuple[View, DetectedChart]],
    files: Mapping[str, Matrix | None],
    models: Mapping[str, str],
) -> Charts:
    """Return the colours of all cameras from the charts seen.

    files: camera_from_rec709 as the files name it, models: make and model, both of every RAW camera by name.
    A camera that saw no chart gets the matrix of one of its model that did.
    """
    reference = chart()
    patches = {name: view_found[1].patches for name, view_found in detected.items()}
    trial, rungs, errors = _climb(patches, files, models, reference)
    fits = trial.by_camera(fit, patches, reference)
    matrices = {
        name: as_matrix(with_rgb(files[name] or np.eye(3), one.camera_from_rec709))
        for name, one in fits.items()
    }
    for name in files:
        if name not in matrices:
            twin = next((other for other in fits if models[other] == models[name]), None)
            if twin is not None:
                matrices[name] = _of_twin(matrices[twin], files[twin], files[name])
    balanced = {
        name: held_out([patches[name]], reference, of_camera(matrix[:3], balanced=True))[0]
        for name, matrix in files.items()
        if matrix is not None and name in patches
    }
    evidence = {
        name: _evidence(
            view,
            chart_found,
            fits[name].colours(chart_found.patches),
            reference,
            errors[name],
            balanced.get(name),
        )
        for name, (view, chart_found) in detected.items()
    }
    return Charts(matrices, evidence, rungs)


def _climb(
    patches: Mapping[str, ChartPatches],
    files: Mapping[str, Matrix | None],
    models: Mapping[str, str],
    reference: Array,
) -> tuple[_Trial, tuple[Rung, ...], dict[str, Array]]:
    """Climb from the files' matrix to the terms that held-out patches justify: the trial, its rungs, its
    held-out errors.
    """
    alone = tuple((name,) for name in patches)
    alike: dict[str, list[str]] = {}
    for name in patches:
        alike.setdefault(models[name], []).append(name)
    shared = tuple(tuple(group) for group in alike.values())
    named = [(files[name] or as_matrix(np.eye(3)))[:3] for name in patches]
    trial = _Trial(alone, tuple(of_camera(matrix, balanced=False) for matrix in named))
    errors = trial.by_camera(held_out, patches, reference)
    rungs: list[Rung] = []

    def climb(name: str, taller: _Trial, what: str) -> None:
        nonlocal trial, errors
        trial_errors = taller.by_camera(held_out, patches, reference)
        # Cameras err alike on a patch, so that a patch is one sample, however many see it.
        gains = _patchwise(errors) - _patchwise(trial_errors)
        gains = gains[np.isfinite(gains)]
        error = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        rungs.append(Rung.judged(name, float(gains.mean()), error, UNIT, what))
        if rungs[-1].taken:
            trial, errors = taller, trial_errors

    climb(
        "chart_white",
        _Trial(alone, tuple(of_camera(matrix, balanced=True) for matrix in named)),
        "white as the chart's greys show it",
    )
    shaded = tuple(replace(model, shaded=True) for model in trial.models)
    climb("chart_shading", _Trial(trial.groups, shaded), "the light may grow across the chart")
    lit = trial.models[0].shaded
    climb(
        "chart_matrix",
        _Trial(shared, (ColourModel(shaded=lit),) * len(shared)),
        f"a matrix from {and_list(sorted(patches))}, one for each camera model, in place of the files'",
    )
    if len(alone) > len(shared):
        climb(
            "chart_matrix_each_camera",
            _Trial(alone, (ColourModel(shaded=lit),) * len(alone)),
            "a matrix for each camera that saw the chart",
        )
    return trial, tuple(rungs), errors


def _patchwise(errors: Mapping[str, Array]) -> Array:
    """The mean over cameras that saw a patch well, NaN where none did."""
    table = np.array(list(errors.values()))
    count = np.isfinite(table).sum(axis=0)
    return np.where(count > 0, np.nansum(table, axis=0) / np.maximum(count, 1), np.nan)


def _of_twin(matrix: Matrix, files_twin: Matrix | None, files_own: Matrix | None) -> Matrix:
    """A twin's matrix, white as much apart as the files of both say."""
    if files_twin is None or files_own is None:
        return matrix
    whites = np.array(files_own)[:3].sum(axis=1) / np.array(files_twin)[:3].sum(axis=1)
    return as_matrix(with_rgb(matrix, (whites / whites[1])[:, None] * np.array(matrix)[:3]))


def _evidence(
    view: View, chart: DetectedChart, measured: Array, reference: Array, errors: Array, files: Array | None
) -> ChartEvidence:
    used = np.flatnonzero(chart.patches.usable)
    known = errors[used]
    corners = tuple((float(x), float(y)) for x, y in chart.outlines[[0, 5, 23, 18], [0, 1, 2, 3]])
    return ChartEvidence(
        frame=view.frame,
        chart=EDITION,
        patches=tuple(
            ChartPatch(
                number=int(index) + 1,
                measured=triple(measured[index]),
                published=triple(reference[index]),
                delta_e=float(errors[index]),
            )
            for index in used
        ),
        delta_e_mean=float(known.mean()),
        delta_e_p95=float(np.percentile(known, 95)),
        delta_e_max=float(known.max()),
        delta_e_files=None if files is None else float(np.nanmean(files)),
        corners=corners,
    )
