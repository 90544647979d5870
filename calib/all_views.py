"""Features of all views: several at a time, as cores and memory allow."""

from collections.abc import Iterator, Mapping, Sequence

from calib.assemble import Evidence
from calib.data.features import FeatureKind
from calib.data.unfinished import Unfinished
from calib.data.views import View
from calib.exports import pictures
from calib.view_images import ViewSummary, summarise
from imaging.arrays import Bytes
from imaging.compute import memory
from imaging.compute.cores import available_cores
from imaging.compute.processes import in_processes
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord
from imaging.session.view_id import ViewId

WORTHWHILE = 50e6
"""Samples of all images above which other processes are begun: each takes some two seconds to begin, in which
it would be through ten million."""
PER_SAMPLE = 40
"""Bytes that looking at a view takes for each sample of its images: 21 of a JPEG, 34 of a RAW bracket
were measured."""
PER_PROCESS = 400_000_000
"""Bytes of a process besides: of its libraries and its compiled kernels; 240 million were measured."""
ROOM = 0.5
"""Share of the free memory that all processes together may take."""


def summaries(
    evidence: Evidence, unfinished: Unfinished, progress: Progress, kind: FeatureKind = "sift"
) -> dict[ViewId, ViewSummary]:
    """Return what calibration keeps of the images of every view; what an earlier run kept is not found again.

    kind: of features to look for.
    """
    every = {view.id: unfinished.large(f"{kind} {view.id}") for view in evidence.views}
    missing = [view for view in evidence.views if every[view.id] is None]
    known = len(every) - len(missing)
    computed = in_processes(
        processes(missing),
        summarise,
        [
            (
                evidence.session,
                view,
                {shot.file: evidence.light.scale[shot.file] for shot in view.shots},
                evidence.light.responses[view.camera.name],
                evidence.sensors[view.camera.name].camera_from_rec709,
                kind,
            )
            for view in missing
        ],
    )
    step = "finding features" if kind == "sift" else f"finding {kind} features"
    progress(step, known, len(every))
    for done, (view, summary) in enumerate(zip(missing, computed, strict=True), known + 1):
        every[view.id] = arrays = summary.arrays()
        unfinished.keep_large(f"{kind} {view.id}", arrays)
        progress(step, done, len(every))
    return {view: ViewSummary.of(arrays) for view, arrays in every.items() if arrays is not None}


def shown(
    evidence: Evidence, record: CalibrationRecord, sizes: Mapping[ViewId, tuple[int, int]], factor: float
) -> Iterator[tuple[ViewId, Bytes]]:
    """Picture of each view, at the size (w, h) at which its features were found; factor: its exposure."""
    previews = in_processes(
        processes(evidence.views),
        pictures.picture,
        [
            (
                evidence.session,
                view,
                {shot.file: evidence.light.scale[shot.file] for shot in view.shots},
                evidence.light.responses[view.camera.name],
                record.camera(view.camera.name).camera_from_rec709,
                sizes[view.id],
                factor,
            )
            for view in evidence.views
        ],
    )
    yield from zip((view.id for view in evidence.views), previews, strict=True)


def processes(views: Sequence[View]) -> int:
    """Return how many processes are to look at views at a time; 1: this one."""
    samples = [
        sum(shot.width * shot.height * (1 if view.camera.kind == "raw" else 3) for shot in view.shots)
        for view in views
    ]
    if sum(samples) < WORTHWHILE:
        return 1
    fit = ROOM * memory.available() / (PER_PROCESS + PER_SAMPLE * max(samples))
    return max(min(available_cores(), len(views), int(fit)), 1)
