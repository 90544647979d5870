"""The baseline: 3DGS (Kerbl et al., arXiv 2308.04079) with its own colours, and nothing of HDR.

On RAW and EXR, and on photographs beside them, it sees the same mosaics, mu-law, loss, schedule and
start as NH-3DGS; only the appearance differs, with learning rates tuned for it (bench/appearance.py).
On photographs alone it is 3DGS as published, in display values.
"""

from dataclasses import replace

import numpy as np

from imaging.calibration import Response
from recon.appearance import PlainHarmonics, Rate
from recon.dataset import Dataset
from recon.method import Light, Method
from recon.mixed import linear_or_mixed
from recon.photographs import Display

NAME = "vanilla"
APPEARANCE = PlainHarmonics()


def compose(dataset: Dataset, light: Light) -> Method:
    """For any session."""
    if dataset.kind != "ldr":
        return Method(
            name=NAME,
            appearance=replace(APPEARANCE, dc_rate=Rate(1e-4, 1e-5), rest_rate=Rate(5e-6, 5e-7)),
            observation=linear_or_mixed(dataset, light),
        )
    responses: list[Response] = [view.sensor.response for view in dataset.train]
    scales = [shot.k for view in dataset.train for shot in view.shots]
    return Method(
        name=NAME,
        appearance=APPEARANCE,
        observation=Display(responses[0], float(np.exp(np.median(np.log(scales))))),
    )
