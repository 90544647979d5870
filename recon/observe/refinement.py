"""Corrections of the calibration by training: poses, exposures, vignetting and glare, a little each.

Parameters beside the Gaussians, all zero at first but for the glare, which comes from scene points. They move
after the scene has taken shape; before that they would follow its gaps. Gauge freedoms are removed from them
after every step: a motion or a scale of all cameras together, and one factor on all exposures.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import Array, Array32
from imaging.session.records import Rung
from recon.data.dataset import Dataset, View
from recon.observe.glare import scattered
from recon.scene.appearance import Rate
from recon.scene.checkpoint import Checkpoint
from recon.splat import SplatCamera
from recon.splat.corrected_camera import DELTA, moved

Refined = Literal["poses", "exposures", "vignetting", "glare"]

BEGIN = 0.2
"""Share of the training after which the corrections are let go."""
RATES: dict[Refined, Rate] = {
    "poses": Rate(2e-3, 2e-5),
    "exposures": Rate(2e-2, 2e-4),
    "vignetting": Rate(2e-1, 1e-4),
    "glare": Rate(1e-3, 1e-5),
}
"""Learning rates of the corrections. A view is used once an epoch, and Adam divides by its mean gradient:
each step moves a pose by the rate times the square root of the number of views.
"""
MOST_GLARE = 0.2
"""A lens that scatters more of the light shows nothing else."""


@dataclass(eq=False)
class Refinement:
    """The corrections of one training; `parameters` holds those that are trained, float32.

    poses [V, 6]: motion of each training view in camera axes, after `cam_from_world`: translation in units of
    the scene's extent, then rotation vector, radians. exposures [S]: natural log of a factor on the scale of
    each training shot. vignetting [C, 3]: of each camera, `1 + a r^2 + b r^4 + c r^6` times the calibrated
    falloff, r = 1 at the corner. glare [C]: share of the light that each camera's lens scatters.
    """

    dataset: Dataset
    parameters: dict[Refined, Tensor]
    rungs: tuple[Rung, ...] = ()
    """Reasons for and against corrections."""
    _views: dict[str, int] = field(init=False, repr=False)
    _shots: dict[str, int] = field(init=False, repr=False)
    _cameras: dict[str, int] = field(init=False, repr=False)
    _gauges: dict[Refined, Tensor] = field(init=False, repr=False, default_factory=dict)
    _powers: dict[tuple[int, int], Tensor] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Number views, shots and cameras, and find the gauge freedoms of the poses."""
        self._views = {view.name: row for row, view in enumerate(self.dataset.train)}
        files = [shot.file for view in self.dataset.train for shot in view.shots]
        self._shots = {file: row for row, file in enumerate(files)}
        cameras = dict.fromkeys(view.camera for view in self.dataset.train)
        self._cameras = {camera: row for row, camera in enumerate(cameras)}
        gauges: dict[Refined, Callable[[Dataset], Array]]
        gauges = {"poses": _pose_gauge, "exposures": _exposure_gauge}
        for name in gauges.keys() & self.parameters.keys():
            self._gauges[name] = torch.from_numpy(gauges[name](self.dataset).astype(np.float32))

    @classmethod
    def of(
        cls,
        dataset: Dataset,
        names: Collection[Refined],
        rungs: tuple[Rung, ...] = (),
        glare: Tensor | None = None,
    ) -> "Refinement":
        """Make zero corrections; `names`: those allowed. glare: its prior, or None."""
        shapes: dict[Refined, tuple[int, ...]] = {
            "poses": (len(dataset.train), 6),
            "exposures": (sum(len(view.shots) for view in dataset.train),),
            "vignetting": (len({view.camera for view in dataset.train}), 3),
            "glare": (len({view.camera for view in dataset.train}),),
        }
        parameters = {name: torch.zeros(shapes[name]) for name in shapes if name in names}
        if glare is not None and "glare" in parameters:
            parameters["glare"] = glare.clone()
        return cls(dataset, parameters, rungs)

    @classmethod
    def stored(cls, dataset: Dataset, checkpoint: Checkpoint) -> "Refinement":
        """Restore the state in a checkpoint's training on the same data set."""
        tensors = checkpoint.part("refinement")
        rungs = tuple(Rung.model_validate(rung) for rung in checkpoint.facts.get("refinement", []))
        names: tuple[Refined, ...] = get_args(Refined)
        return cls(dataset, {name: tensors[name] for name in names if name in tensors}, rungs)

    def to(self, device: torch.device) -> None:
        """Move the parameters but the poses: the host moves the cameras, and would wait to read how far."""
        for values in (self.parameters, self._gauges):
            values |= {name: value.to(device) for name, value in values.items() if name != "poses"}

    def motion(self, view: View, progress: float) -> Tensor | None:
        """Motion of a training view's camera, [14], on the CPU, as `rasterize` wants it; None without one."""
        if progress < BEGIN or "poses" not in self.parameters:
            return None
        return camera_delta(self.parameters["poses"][self._views[view.name]], self.dataset.extent)

    def factors(self, view: View, progress: float) -> Tensor | None:
        """Factors on the exposure scales of a training view's shots, [shots]; None: all are 1."""
        if progress < BEGIN or "exposures" not in self.parameters:
            return None
        rows = torch.tensor([self._shots[shot.file] for shot in view.shots])
        exposures = self.parameters["exposures"]
        return exposures[rows.to(exposures.device, non_blocking=True)].exp()

    def through_lens(self, image: Tensor, view: View, progress: float) -> Tensor:
        """An image [H, W, 3] behind the corrected parts of glare and vignetting."""
        row = self._cameras.get(view.camera)
        if "glare" in self.parameters and row is not None:
            share = self.parameters["glare"][row]
            image = scattered(image, share if progress >= BEGIN else share.detach())
        return self._shaded(image, view, progress)

    def _shaded(self, image: Tensor, view: View, progress: float) -> Tensor:
        row = self._cameras.get(view.camera)
        if progress < BEGIN or "vignetting" not in self.parameters or row is None:
            return image
        size = image.shape[0], image.shape[1]
        if size not in self._powers:
            self._powers[size] = torch.from_numpy(_powers(*size)).to(image)
        return image * (1 + self._powers[size] @ self.parameters["vignetting"][row])[..., None]

    @torch.no_grad()
    def settle(self) -> None:
        """Take out of the corrections what is one gauge or another of the same scene."""
        for name, gauge in self._gauges.items():
            values = self.parameters[name].view(-1)
            values -= gauge @ (gauge.mT @ values)
        if "glare" in self.parameters:
            self.parameters["glare"].clamp_(0.0, MOST_GLARE)

    def corrected(self, whole: Dataset | None = None) -> Dataset:
        """The data set with everything corrected; the held-out views get their camera's lens alone.

        whole: the same session with other views held out; those that were trained on are corrected.
        """
        dataset = whole or self.dataset
        return replace(
            dataset,
            train=tuple(self._of(view) for view in dataset.train),
            held_out=tuple(self._of(view) for view in dataset.held_out),
        )

    def _of(self, view: View) -> View:
        lens, shots, sensor = view.lens, view.shots, view.sensor
        if view.name in self._views:
            delta, factors = self.motion(view, 1.0), self.factors(view, 1.0)
            if delta is not None:
                lens = moved(lens, delta.detach())[0]
            if factors is not None:
                pairs = zip(shots, factors.detach().double().tolist(), strict=True)
                shots = tuple(replace(shot, k=shot.k * factor) for shot, factor in pairs)
        if "vignetting" in self.parameters:
            plain = torch.from_numpy(sensor.falloff)[..., None]
            shaded = self._shaded(plain, view, 1.0).detach().numpy()[..., 0]
            sensor = replace(sensor, falloff=shaded.clip(1e-3))
        if "glare" in self.parameters and view.camera in self._cameras:
            share = float(self.parameters["glare"].detach()[self._cameras[view.camera]])
            sensor = replace(sensor, glare=share)
        return replace(view, lens=lens, shots=shots, sensor=sensor)

    def described_rungs(self) -> tuple[Rung, ...]:
        """The rungs, those that were taken with how far it went in the middle (median)."""
        values = {name: value.detach().cpu().double() for name, value in self.parameters.items()}
        amounts: dict[str, str] = {}
        if "poses" in values:
            turn, way = (
                float(values["poses"][:, part].norm(dim=1).median()) for part in (slice(3, 6), slice(3))
            )
            amounts["refine poses"] = (
                f"moved by {np.degrees(turn):.2g} degrees and {100 * way:.2g} % of the extent"
            )
        if "exposures" in values:
            amounts["refine exposures"] = (
                f"by {float(values['exposures'].abs().median()) / np.log(2):.2g} stops"
            )
        if "vignetting" in values:
            corner = float(values["vignetting"].sum(dim=1).abs().median())
            amounts["refine vignetting"] = f"by {100 * corner:.2g} % in the corners"
        if "glare" in values:
            share = float(values["glare"].median())
            amounts["refine glare"] = f"{100 * share:.2g} % of the light is scattered"
        return tuple(
            rung.model_copy(update={"reason": f"{rung.reason}; {amounts[rung.name]}"})
            if rung.name in amounts
            else rung
            for rung in self.rungs
        )

    def facts(self) -> dict[str, object]:
        """Sizes of the corrections, by view, file and camera, for people and other programs."""
        facts: dict[str, object] = {"schema_version": 1}
        values = {name: value.detach().cpu().double() for name, value in self.parameters.items()}
        if "poses" in values:
            turns, ways = (values["poses"][:, part].norm(dim=1) for part in (slice(3, 6), slice(3)))
            facts["poses"] = {
                name: {
                    "rotation_deg": float(np.degrees(float(turns[row]))),
                    "translation_relative": float(ways[row]),
                }
                for name, row in self._views.items()
            }
        if "exposures" in values:
            stops = values["exposures"] / np.log(2)
            facts["exposures_stops"] = {file: float(stops[row]) for file, row in self._shots.items()}
        if "vignetting" in values:
            facts["vignetting"] = {
                name: values["vignetting"][row].tolist() for name, row in self._cameras.items()
            }
        if "glare" in values:
            facts["glare"] = {name: float(values["glare"][row]) for name, row in self._cameras.items()}
        return facts


def camera_delta(pose: Tensor, extent: float) -> Tensor:
    """A correction of a pose [6], in the units of `Refinement`, as the `camera_delta` of `rasterize`."""
    return torch.cat([extent * pose[:3], pose[3:], pose.new_zeros(DELTA - 6)])


def _pose_gauge(dataset: Dataset) -> Array:
    """Orthonormal corrections of all poses that change no picture, to first order, [6 V, 7 or fewer].

    They are a shift, a turn and a scale of the whole world, about the mean of the cameras.
    """
    lenses: list[SplatCamera] = [view.lens for view in dataset.train]
    middle = np.mean([view.centre for view in dataset.train], axis=0)
    rows = []
    for lens, view in zip(lenses, dataset.train, strict=True):
        turn = lens.cam_from_world[:3, :3]
        off = turn @ (middle - view.centre)
        cross = np.array([[0, -off[2], off[1]], [off[2], 0, -off[0]], [-off[1], off[0], 0]])
        shift = np.concatenate([turn, cross @ turn, off[:, None]], axis=1) / dataset.extent
        rows.append(
            np.concatenate([shift, np.concatenate([np.zeros((3, 3)), turn, np.zeros((3, 1))], axis=1)])
        )
    basis, sizes, _ = np.linalg.svd(np.concatenate(rows), full_matrices=False)
    return np.asarray(basis[:, sizes > 1e-6 * sizes.max()])


def _exposure_gauge(dataset: Dataset) -> Array:
    """The correction of ln k that is one factor on all exposures, of length 1, [S, 1]."""
    count = sum(len(view.shots) for view in dataset.train)
    return np.full((count, 1), count**-0.5)


def _powers(height: int, width: int) -> Array32:
    """r^2, r^4 and r^6 of every pixel, [H, W, 3], as `imaging.session.falloff` has them."""
    y = (np.arange(height) + 0.5 - height / 2)[:, None]
    x = (np.arange(width) + 0.5 - width / 2)[None]
    square = (x**2 + y**2) / ((height / 2) ** 2 + (width / 2) ** 2)
    return np.stack([square, square**2, square**3], -1).astype(np.float32)
