"""InstantHDR's measure of light (Ye et al., arXiv 2603.11298), after its post-optimisation's evaluation.

Render and truth are each divided by the 99th percentile of their own values, clipped to 0..1 and taken
through the mu-law with mu 5000, so that no scale matters. PSNR and SSIM of that are means over test views.
"""

from pathlib import Path

import numpy as np

from imaging import metrics
from imaging.arrays import Array, Array32
from imaging.errors import ReconstructionError
from imaging.progress import Progress, unreported
from recon.measure.truth import has_truth, true_radiance
from recon.result.opened import open_model

SIDE = 448
"""px of the pictures that are compared."""
PERCENTILE = 99.0
FAINTEST = 1e-6
"""Least divisor."""


def measure(folder: Path, progress: Progress = unreported) -> dict[str, float]:
    """`score` of the held-out views of SESSION/reconstructions/NAME, means.

    ReconstructionError if it has none, or no true light.
    """
    opened = open_model(folder, progress, SIDE)
    views, session = opened.dataset.reported, opened.dataset.session
    if not views or not has_truth(session):
        raise ReconstructionError(f"{folder} has no held-out views with true light: import the scene again.")
    rows = []
    for done, view in enumerate(views):
        progress("measuring held-out views", done, len(views))
        rows.append(score(opened.radiance(view), true_radiance(session, view)))
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def score(light: Array32, truth: Array32) -> dict[str, float]:
    """Score linear light [H, W, 3] in any unit: `hdr_psnr_p99` (dB) and `hdr_ssim_p99`."""
    ours, true = shown(light), shown(truth)
    similarity = metrics.ssim(ours, true)
    assert similarity is not None  # no sample is masked
    return {"hdr_psnr_p99": metrics.psnr(ours, true), "hdr_ssim_p99": similarity}


def shown(light: Array32) -> Array:
    """Linear light as it is compared, 0..1, float64."""
    values = np.asarray(light, np.float64)
    white = max(float(np.percentile(values, PERCENTILE)), FAINTEST)
    return metrics.mu_law(np.clip(values / white, 0, 1))
