"""Evaluation of a reconstruction: held-out views against the truth, if known, and the shots."""

import math
import time
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from imaging.and_list import and_list
from imaging.arguments import checked
from imaging.arrays import Array
from imaging.errors import ReconstructionError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.paths import find_reconstruction
from recon.data.holdout import FEWEST_FOR_HOLDOUT
from recon.data.tone import encode
from recon.measure import vdp
from recon.measure.evaluation import Evaluation
from recon.measure.pace import views_in_time
from recon.measure.perceptual import compare_pictures
from recon.measure.truth import calibration_errors, has_truth, response_rmse
from recon.measure.view_figures import measured, reference_light
from recon.observe.mixed import Mixed
from recon.observe.photographs import ToneCurve
from recon.result.model import SPLATS, read_model
from recon.result.opened import Opened, open_model
from recon.splat.torch_threads import torch_on_one_thread

METRICS = "metrics.json"
FIGURES = 0.6
"""Share of the time of an evaluation in which its views are measured, before their pictures are compared."""

LOOKED_AT = (
    "The only held-out view could also end the training, so these are figures of a view that was looked at: "
    "take 9 views or more, or train without --early-stop and without a budget in dB."
)


@checked
def evaluate(
    folder: str | PathLike[str],
    *,
    width: int | None = None,
    until: float = math.inf,
    on_progress: Progress = unreported,
) -> Evaluation:
    """Evaluate a reconstruction on its held-out views, and write metrics.json and the compared pictures.

    renders/ and references/ hold the pictures that are compared (`recon.measure.perceptual`). Figures against
    truth use one peak, the truth's maximum over the held-out views, and `_aligned` ones a single scale for
    all of them; PSNRs are means over views, stops_median and relative_error_by_decade (of aligned radiance)
    pool their values. Without truth, errors in stops are against the held-out photographs
    (`recon.measure.recorded_light`). `rig.report.metric_words` explains the names.

    Args:
        folder: SESSION/reconstructions/NAME, or a session for its newest.
        width: Width of the widest picture, px; None: that of the training. Only figures of one width can be
            compared, since a wider picture asks for more detail (`common_width`).
        until: Reading of `time.monotonic` by which it should be done. Where that is too early for all
            held-out views, or for FLIP of all, an even choice of them is measured, and `left_out` says so.
        on_progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Figures of the scene, of each view, and of each band of a scene of bands. `measured_on` states whether
        the views are test views, on which no choice rests, or the validation view that ended the training, if
        that is the only one. Where no view is held out, as below four, the result says so and has no
        figures.

    Raises:
        ReconstructionError: The folder has no finished reconstruction.
        InputError: The session is damaged, or the width cannot be used.
        StorageError: The disk refuses.
    """
    folder = find_reconstruction(Path(folder))
    if folder.is_file():
        raise ReconstructionError(
            f"{folder} is a file of splats, without the photographs that it could be measured by: name a "
            "scene that rig trained."
        )
    store.require_writable(folder)
    opened = open_model(folder, on_progress, width)
    with torch_on_one_thread():
        result = _evaluated(folder, opened, until, on_progress)
    evaluation = Evaluation.model_validate(result)
    store.write_json(folder / METRICS, evaluation.known())
    return evaluation


def _evaluated(folder: Path, whole: Opened, until: float, on_progress: Progress) -> dict[str, Any]:
    """The fields of `Evaluation`."""
    now = time.monotonic()
    opened = views_in_time(whole, now + FIGURES * (until - now), measured)
    views = opened.dataset.reported
    light, seconds, rows, pooled = measured(opened, on_progress)
    result: dict[str, Any] = {"method": opened.record.settings.method} | pooled
    if views:
        result["width"] = max(view.lens.width for view in views)
        result["measured_on"] = "test" if opened.dataset.test else "validation"
        if not opened.dataset.test:
            result["held_out_note"] = LOOKED_AT
        scale = float(pooled.get("alignment_scale", 1.0))
        reference = reference_light(opened)
        looks, skipped = compare_pictures(folder, opened, light, reference, scale, on_progress, until)
        rows = [row | perceived for row, perceived in zip(rows, looks, strict=True)]
        for key in sorted({key for row in rows for key in row} - {"view"} - set(result)):
            result[key] = float(np.mean([row[key] for row in rows if key in row]))
        said = _left_out(len(views), len(whole.dataset.reported), skipped), vdp.trouble()
        result["left_out"] = " ".join(filter(None, said)) or None
    else:
        result["held_out_note"] = _none_held_out(opened)
    if has_truth(opened.dataset.session):
        result |= calibration_errors(opened.dataset.session, opened.dataset.calibration)
        result |= _response(opened)
    result |= {
        "train_seconds": opened.record.train_seconds,
        "iterations": opened.training.iteration,
        "gaussians": len(opened.training.gaussians),
        "size_bytes": (folder / SPLATS).stat().st_size,
        "held_out": [view.name for view in whole.dataset.test],
        "validation": [view.name for view in whole.dataset.validation],
        "views": rows,
    }
    if seconds:
        result["render_fps"] = 1 / float(np.median(seconds))
    on_progress("rendering held-out views", len(views), len(views))
    return result


def _none_held_out(opened: Opened) -> str:
    """Say why no view is held out of a training."""
    count = len(opened.dataset.views)
    if opened.record.settings.all_views:
        return f"All {count} views were trained on, as asked for: none is left to measure with."
    views_are = "1 view is" if count == 1 else f"{count} views are"
    return f"{views_are} too few to hold one out: take {FEWEST_FOR_HOLDOUT} or more."


def _left_out(measured: int, of: int, skipped: Sequence[str]) -> str | None:
    """Say what there was not time for; None if nothing."""
    if measured == of and not skipped:
        return None
    views = f"{measured} of {of} held-out views are" if measured < of else f"All {of} held-out views are"
    but = f", {'' if measured < of else 'but '}{and_list(skipped)}" if skipped else ""
    return f"{views} measured{but}, to finish the report in time: `rig evaluate` measures all."


def common_width(folders: Sequence[Path]) -> int:
    """The width, px, at which scenes of a session are compared: that of the one trained finest."""
    return max(read_model(folder).width for folder in folders)


def _response(opened: Opened) -> dict[str, float]:
    """response_rmse of the learned curve, else of the calibrated one."""
    responses = [view.sensor.response for view in opened.dataset.views if view.sensor.kind == "ldr"]
    if not responses:
        return {}
    observation = opened.training.method.observation
    if isinstance(observation, Mixed):
        observation = observation.photographs
    response = responses[0]

    def calibrated(logs: Array) -> Array:
        return encode(np.exp(logs)[:, None].repeat(3, 1), response).astype(np.float64)

    code_of = observation.codes_of if isinstance(observation, ToneCurve) else calibrated
    value = response_rmse(opened.dataset.session, code_of)
    return {} if value is None else {"response_rmse": value}
