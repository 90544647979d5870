"""The PLY files of a scene: one that viewers show as it should look, and one of its linear light."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from imaging.files import store
from imaging.progress import Progress
from imaging.session.bands import false_colour
from imaging.session.records import Band
from recon.data.dataset import Dataset
from recon.data.world import Vector
from recon.observe.photographs import Display
from recon.result.environment_files import DOME, dome_of
from recon.result.model import RADIANCE, SPLATS
from recon.result.splats.display_colours import LitScene, display_colours, steps_after
from recon.scene.appearance import Appearance, Parameters, Rate
from recon.scene.ply import plain_harmonics, write_ply
from recon.train.training import Training

BLENDED = "fitted so that pictures of viewers look right; colours end at 1"
"""Name of display values, for headers."""


def offset_of(dataset: Dataset) -> Vector:
    """Return what the coordinates in the files leave out of those of the world."""
    return dataset.world.offset(max(max(view.lens.fx, view.lens.fy) for view in dataset.views))


@dataclass(frozen=True)
class _FalseColour:
    """The light of bands as the eye is shown it: another appearance, in linear Rec.709.

    matrix: float32 [3, bands].
    """

    appearance: Appearance
    matrix: Tensor
    rates: ClassVar[dict[str, Rate]] = {}

    def start(self, light: Tensor) -> Parameters:
        """Start of the bands."""
        return self.appearance.start(light)

    def colours(self, parameters: Parameters, directions: Tensor, degree: int) -> Tensor:
        """Linear Rec.709 [N, 3] >= 0."""
        light = self.appearance.colours(parameters, directions, degree)
        return (light @ self.matrix.to(light).T).clamp_min(0.0)

    def luminance(self, parameters: Parameters) -> Tensor:
        """Luminance of the bands."""
        return self.appearance.luminance(parameters)

    def penalty(self, parameters: Parameters) -> Tensor:
        """Penalty of the bands."""
        return self.appearance.penalty(parameters)


def shown_in_colour(appearance: Appearance, bands: Sequence[Band]) -> Appearance:
    """Return what gives Gaussians the colours that the eye is shown: itself, or of bands false ones."""
    if not bands:
        return appearance
    return _FalseColour(appearance, torch.from_numpy(false_colour(bands).astype(np.float32)))


def what_is_shown(bands: Sequence[Band]) -> str:
    """Return what the colours of `shown_in_colour` are, in words."""
    if not bands:
        return "linear Rec.709 radiance"
    return f"false colours of the bands {', '.join(band.name for band in bands)}"


def write_splats(
    folder: Path,
    dataset: Dataset,
    training: Training,
    exposure: float,
    gauge: str,
    luminance: tuple[float, float] | None,
    progress: Progress,
) -> float | None:
    """Write splats.ply, of display values, and radiance.ply, of linear Rec.709 radiance in scene units.

    Of a scene of bands both are in false colours, as viewers know three channels; the light is in the
    checkpoint. A scene that was trained on display values has splats.ply alone, with just the coefficients
    that were trained.

    Args:
        folder: Of the scene.
        dataset: Views that it was trained on and is judged by, as corrected.
        training: Training whose present state is written.
        exposure: Factor on radiance in the units of the calibration before it is encoded.
        gauge: Name of those units.
        luminance: What 1 in those units is in cd/m2, with its standard error, if it is known.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The PSNR of splats.ply, dB (`DisplayColours.db`); None of a scene that was trained on display values.
    """
    method, light = training.method, training.light
    degree, offset = method.degree(1.0), offset_of(dataset)
    place = ["offset {!r} {!r} {!r}: add it to x y z".format(*offset)] if any(offset) else []
    place.append(f"coordinates: {dataset.calibration.coordinate_note}")
    drawn, far = training.gaussians, training.environment
    if far is not None:
        dome = dome_of(far, method.appearance, len(drawn))
        drawn = drawn.joined(dome.to(drawn.parameters["means"].device))
        place.append(
            f"light from far away: the last {len(dome)} Gaussians, a sphere {DOME:g} times as far as what is "
            f"looked at"
        )
    gaussians = drawn.to(torch.device("cpu"))
    appearance = shown_in_colour(method.appearance, dataset.bands)
    renderer = replace(training.renderer(), appearance=appearance)
    what = what_is_shown(dataset.bands)
    harmonics = plain_harmonics(gaussians, appearance, degree)
    if isinstance(method.observation, Display):
        note = "display values, the codes of the photographs"
        write_ply(folder / SPLATS, gaussians, harmonics, [note, *place], dataset.world, offset)
        store.discard(folder / RADIANCE)
        return None
    note = f"{what} over {light.normaliser:.6g} ({gauge}); not clipped, not tone-mapped"
    absolute = []
    if luminance is not None:
        value, error = (light.normaliser * part for part in luminance)
        absolute = [
            f"whiteLuminance {value:.6g}: cd/m2 of (1, 1, 1) in this file, standard error {error:.3g}"
        ]
    write_ply(folder / RADIANCE, gaussians, harmonics, [note, *absolute, *place], dataset.world, offset)
    shown = display_colours(
        LitScene(training.gaussians, renderer, degree, exposure * light.normaliser),
        drawn,
        steps_after(training.iteration),
        fitted=[view.lens for view in dataset.train],
        judged=[view.lens for view in dataset.held_out],
        progress=progress,
    )
    note = (
        f"display values: sRGB of {what} x {exposure:.6g} ({gauge}); {BLENDED}; "
        f"drawn by a viewer {shown.db:.1f} dB from that; linear light is in {RADIANCE}"
    )
    write_ply(folder / SPLATS, gaussians, shown.harmonics, [note, *place], dataset.world, offset)
    return shown.db
