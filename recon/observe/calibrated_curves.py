"""The tone curves that a training on photographs starts from: those of the calibration's responses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from imaging.arrays import Array
from imaging.session.calibration import Response
from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.observe.photographs import ToneCurve
from recon.observe.tone_grid import curve_values, grid_nodes, middle_of, needed, remap_rate, sampled
from recon.scene.appearance import Rate

ASSUMED = Rate(2e-1, 5e-4)
"""Learning rate of a curve that was not measured. That of one that was cannot leave a wrong start: where an
assumed curve is flat and the true one is not, its steps have to grow fifty times
(bench/results/ablation_hdr_gs.md)."""
ASSUMED_SMOOTHNESS = 0.1
"""Weight of roughness of a curve that was not measured: such a rate follows more of the noise."""
STOP_APART = 0.99
"""Stops between exposures above which they determine the curve (a little less than one, for rounding)."""
TOO_FAR_APART = 6.0
"""Stops between exposures from which few pixels are well exposed in both."""
KNOWN_RESIDUAL = 0.01
"""A calibrated curve whose held-out disagreement, natural log, is below this counts as known."""


@dataclass(frozen=True)
class Curves:
    """The tone curves that the photographs of a session start from, and the grid that they need.

    responses: the distinct ones; of_camera: which a camera has. rate, middle: x as `ToneCurve` has it.
    nodes [M]: of the grid, out of `finest`. measured: whether they are of a calibration, which training
    only touches up; known: whether it leaves them as they are.
    """

    responses: tuple[Response, ...]
    of_camera: dict[str, int]
    rate: float
    middle: float
    nodes: Array
    finest: int
    measured: bool
    known: bool

    @classmethod
    def of(cls, dataset: Dataset) -> "Curves":
        """Read the responses of the calibration: where they were measured, with the nodes that hold them."""
        photographed = [view for view in dataset.views if view.sensor.kind == "ldr"]
        responses = {view.camera: view.sensor.response for view in photographed}
        distinct = tuple(dict.fromkeys(responses.values()))
        scales = [shot.k for view in dataset.train if view.sensor.kind == "ldr" for shot in view.shots]
        rate = remap_rate(scales)
        middle = float(np.mean([middle_of(response) for response in distinct]))
        residuals = [0.0 if response.kind == "linear" else response.residual for response in distinct]
        measured = None not in residuals
        known = all(residual is not None and residual < KNOWN_RESIDUAL for residual in residuals)
        known = known or not (measured or _separable(dataset, scales))
        nodes = finest = grid_nodes()
        if measured:
            starts = (sampled(response, finest, rate, middle) for response in distinct)
            curves = [curve_values(theta).double().numpy() for theta in starts]
            nodes = finest[needed(finest, np.stack(curves))]
        of_camera = {camera: distinct.index(response) for camera, response in responses.items()}
        return cls(distinct, of_camera, rate, middle, nodes, len(finest), measured, known)


def _separable(dataset: Dataset, scales: Sequence[float]) -> bool:
    """Return whether photographs determine a curve apart from the light that the calibration did not
    measure.

    Exposures that were found in photographs came through the assumed curve themselves.
    """
    gaps = np.diff(np.unique(np.round(np.log2(scales), 2)))
    return not developed(dataset) and bool(((gaps >= STOP_APART) & (gaps < TOO_FAR_APART)).any())


def developed(dataset: Dataset) -> bool:
    """Return whether photographs differ by more than their labels, in exposure or white balance."""
    return any(
        (view.exposure, *view.white_balance) != (1.0,) * 4
        for view in dataset.calibration.views
        if dataset.calibration.camera(view.camera).response.kind != "linear"
    )


def sensitivity_span(dataset: Dataset) -> float:
    """Stops between the least and the most sensitive photograph of the training: by exposure and camera."""
    gains = {camera.name: camera.gain for camera in dataset.calibration.cameras}
    stops = np.log2([shot.k * gains[view.camera] for view in dataset.train for shot in view.shots])
    return float(np.ptp(stops))


def tone_curve(dataset: Dataset, light: Light) -> ToneCurve:
    """The tone curve of the photographs of a session; it starts from the response of the calibration.

    HDRGS starts from a sigmoid; a measured (or sRGB) curve is nearer, and the colours that training
    starts from come through the same curve, so the two agree from the first iteration.
    """
    curves = Curves.of(dataset)
    theta = [sampled(response, curves.nodes, curves.rate, curves.middle) for response in curves.responses]
    made = ToneCurve(
        normaliser=light.normaliser,
        nodes=torch.from_numpy(curves.nodes.astype(np.float32)),
        theta=torch.stack(theta),
        of_camera=curves.of_camera,
        rate=curves.rate,
        middle=curves.middle,
        epsilon=0.01 * (light.reference or 2.0**-20),
        fixed=1.0 if curves.known else 0.2,
    )
    return made if curves.measured else replace(made, curve_rate=ASSUMED, smoothness=ASSUMED_SMOOTHNESS)
