"""HDR-GS with a grid tone curve (Wu et al., arXiv 2408.06543): radiance from bracketed photographs."""

import numpy as np
import torch

from recon.appearance import LuminanceChromaticity
from recon.dataset import Dataset
from recon.method import Light, Method
from recon.photographs import ToneCurve
from recon.tone_grid import Grid, middle_of, remap_rate, sampled

NAME = "hdr-gs"

KNOWN_RESIDUAL = 0.01
"""A calibrated curve whose held-out disagreement, natural log, is below this counts as known."""


def compose(dataset: Dataset, light: Light) -> Method:
    """For photographs with known exposures; the curve starts from the calibration's response.

    The paper starts from a sigmoid; a measured (or sRGB) curve is nearer, and the colours that
    training starts from come through the same curve, so the two agree from the first iteration.
    """
    responses = list({view.camera: view.sensor.response for view in dataset.views}.items())
    distinct = list(dict.fromkeys(response for _, response in responses))
    rate = remap_rate([shot.k for view in dataset.train for shot in view.shots])
    middle = float(np.mean([middle_of(response) for response in distinct]))
    nodes = Grid().nodes()
    known = all(
        response.kind == "linear" or (response.residual is not None and response.residual < KNOWN_RESIDUAL)
        for response in distinct
    )
    return Method(
        name=NAME,
        appearance=LuminanceChromaticity(floor=light.reference or 2.0**-20),
        observation=ToneCurve(
            normaliser=light.normaliser,
            nodes=torch.from_numpy(nodes.astype(np.float32)),
            theta=torch.stack([sampled(response, nodes, rate, middle) for response in distinct]),
            of_camera={camera: distinct.index(response) for camera, response in responses},
            rate=rate,
            middle=middle,
            epsilon=0.01 * (light.reference or 2.0**-20),
            fixed=1.0 if known else 0.2,
        ),
    )
