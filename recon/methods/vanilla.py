"""The baseline: the Gaussians and colours of 3DGS (Kerbl et al., arXiv 2308.04079), trained as rig trains.

Of 3DGS are how Gaussians are drawn and their colours, `max(0, 0.5 + SH)`, and nothing is of HDR. All else
is what the other methods have too: the start (points of a plane sweep beside those of structure from
motion, opacity 0.7, 3DGS: 0.1), learning rates of the geometry, 0.05 of SSIM in the loss (0.2), harmonics
up to degree 2 (3), growth by rank to a given number (above a threshold, to any), no reset of opacities
(every 3,000 iterations), a third of the blur, cut-offs for high contrast, 300 to 4,000 iterations (30,000).
On photographs the learning rates of the colours are those of 3DGS, of what depends on the direction ten times
those at first and twice at the end, since there are fewer iterations.

On photographs alone it is trained on their display values, with no idea of exposure in brackets; of single
photographs, it knows as gains by how much the calibration measured them to differ. On RAW and EXR, and on
photographs beside them, it sees the same mosaics through the same mu-law as NH-3DGS; only the appearance
differs, with learning rates tuned for it (bench/results/appearance.md).
"""

from dataclasses import replace

import numpy as np

from imaging.session.calibration import Response
from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.methods.method import Method
from recon.observe.calibrated_curves import developed, sensitivity_span
from recon.observe.mixed import linear_or_mixed
from recon.observe.photographs import Display
from recon.scene.appearance import PlainHarmonics, Rate

NAME = "vanilla"
APPEARANCE = PlainHarmonics(rest_rate=Rate(1.25e-3, 2.5e-4))
"""Appearance with a learning rate above 1.25e-4 throughout: lego, 200 px, degree 2, 40,000 Gaussians, 2,500
iterations: +0.34 dB over white; castle and monstree, 250 px, 1,000 iterations: +0.1 each.
"""


def compose(dataset: Dataset, light: Light) -> Method:
    """Compose the method for any session."""
    if dataset.kind != "ldr":
        return Method(
            name=NAME,
            appearance=replace(APPEARANCE, dc_rate=Rate(1e-4, 1e-5), rest_rate=Rate(5e-6, 5e-7)),
            observation=linear_or_mixed(dataset, light),
        )
    responses: list[Response] = [view.sensor.response for view in dataset.train]
    scales = [shot.k for view in dataset.train for shot in view.shots]
    single = all(len(view.shots) == 1 for view in dataset.train)
    differ = developed(dataset) or (single and sensitivity_span(dataset) > 0)
    return Method(
        name=NAME,
        appearance=APPEARANCE,
        observation=Display(responses[0], float(np.exp(np.median(np.log(scales)))), differ),
    )
