"""Gaussians as files of other programs have them: the geometry, and the plain harmonics of 3DGS."""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch

from imaging.arrays import Array, Integers, Mask
from imaging.colour.spaces import srgb_decode
from imaging.errors import ReconstructionError
from imaging.progress import Progress, unreported
from recon.data.world import Vector, WorldTransform
from recon.exports import decoding
from recon.exports.stored import drawable, is_stored
from recon.result.environment_files import dome_of
from recon.result.model import SPLATS, DisplayValues
from recon.result.scene import Scene
from recon.result.splats.display_colours import LitScene, display_colours, steps_after
from recon.result.splats.splat_files import shown_in_colour
from recon.scene.environment import Environment
from recon.scene.gaussians import GEOMETRY, Gaussians
from recon.scene.harmonics import C0, COEFFICIENTS
from recon.scene.ply import plain_harmonics
from recon.scene.ply_file import PlySplats, read_ply
from recon.splat import SplatCamera


@dataclass(frozen=True, eq=False)
class Splats:
    """N Gaussians in the axes and the unit of the world, less an offset.

    means [N, 3]; scales [N, 3], standard deviations; quats [N, 4], unit, wxyz; opacities [N], 0..1; harmonics
    [N, (degree + 1)^2, 3] as in 3DGS: a colour is max(0, 0.5 + SH(d)). All float64. linear: colours are
    radiance times `factor`; else sRGB codes, fitted so that pictures drawn of them and clipped at 1 are those
    of that. For display values `factor` is 1, and light that of a display. world: where the scene lies; world
    coordinates are means + offset. dome: the number of the last ones, which represent light from far away; 0
    without them. end: largest code; above 1 codes go on by the formula of sRGB.
    """

    means: Array
    scales: Array
    quats: Array
    opacities: Array
    harmonics: Array
    linear: bool
    factor: float
    world: WorldTransform
    offset: Vector
    dome: int = 0
    end: float = 1.0

    def __len__(self) -> int:
        return len(self.means)

    @property
    def degree(self) -> int:
        """Degree of the harmonics."""
        return math.isqrt(self.harmonics.shape[1]) - 1

    @property
    def colours(self) -> Array:
        """The mean of each over all directions, [N, 3], >= 0."""
        return np.maximum(0.5 + C0 * self.harmonics[:, 0], 0)

    @property
    def light(self) -> Array:
        """The same as radiance; of display values what they decode to."""
        colours = self.colours
        return np.asarray((colours if self.linear else self.decoded(colours)) / self.factor)

    @property
    def brightest(self) -> float | None:
        """Largest light that the colours can have, as a multiple of a display's white; None: any."""
        return None if self.linear else float(srgb_decode(self.end, end=self.end))

    def decoded(self, codes: Array) -> Array:
        """Codes as light, 1 being a display's white."""
        return np.asarray(srgb_decode(codes, end=self.end))

    @property
    def logits(self) -> Array:
        """Opacities as files of 3DGS have them; those of 1 as the nearest that float32 draws as 1."""
        inside = self.opacities.clip(1e-12, 1 - 2.0**-25)
        return np.asarray(np.log(inside / (1 - inside)))

    def gaussians(self) -> Gaussians:
        """The same in scene coordinates, float32, of `PlainHarmonics`."""
        rest = np.zeros((len(self), COEFFICIENTS - 1, 3))
        rest_terms = min(self.harmonics.shape[1], COEFFICIENTS) - 1
        rest[:, :rest_terms] = self.harmonics[:, 1 : rest_terms + 1]
        values = {
            "means": self.world.from_world(self.means + self.offset),
            "log_scales": np.log(self.scales / self.world.unit),
            "quats": self.quats,
            "opacity_logits": self.logits,
            "sh_dc": self.harmonics[:, :1],
            "sh_rest": rest,
        }
        return Gaussians({name: torch.from_numpy(value.astype(np.float32)) for name, value in values.items()})

    def in_single(self) -> "Splats":
        """The same as float32 holds it; one half is added to the light, which takes of what is dim."""
        return replace(self, harmonics=self.harmonics.astype(np.float32).astype(np.float64))

    def rows(self, chosen: Mask | Integers) -> "Splats":
        """Some of them, or in another order."""
        names = ("means", "scales", "quats", "opacities", "harmonics")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})


def sound(scene: Scene) -> tuple[Scene, int]:
    """The scene without Gaussians that no renderer draws, and how many those are.

    They are those with a value that is not finite, without a turn, or with an opacity of 0.
    ReconstructionError if none is left.
    """
    finite = drawable(scene.gaussians)
    if not finite.any():
        raise ReconstructionError(
            f"{scene.folder} holds no Gaussian that can be drawn, so there is nothing to export: reconstruct "
            "it again."
        )
    dropped = int((~finite).sum())
    if not dropped:
        return scene, 0
    sampling = scene.renderer.sampling
    if sampling is not None:
        sampling = replace(sampling, least=sampling.least[finite], most=sampling.most[finite])
    renderer = replace(scene.renderer, sampling=sampling)
    return replace(scene, gaussians=Gaussians(scene.gaussians.rows(finite)), renderer=renderer), dropped


def linear_splats(scene: Scene, factor: float, *, with_dome: bool) -> Splats:
    """A scene's radiance times `factor`; of bands in false colours.

    with_dome: light from far away as a sphere of Gaussians behind the others; else it is left out.
    Of display values what they decode to: see `_decoded`.
    """
    record = scene.record
    if record.display is not None:
        return _decoded(scene, record.display, factor, with_dome)
    gaussians, dome = _with_dome(scene) if with_dome else (scene.gaussians, 0)
    appearance = shown_in_colour(scene.renderer.appearance, record.bands)
    harmonics = plain_harmonics(gaussians, appearance, record.degree)
    return _splats(scene, gaussians, rescaled(harmonics, factor * record.normaliser), True, factor, dome)


def _with_dome(scene: Scene) -> tuple[Gaussians, int]:
    """The Gaussians and, behind them, light from far away as a sphere of others; how many these are."""
    gaussians, far = scene.gaussians, scene.renderer.environment
    if far is None:
        return gaussians, 0
    sphere = dome_of(far, scene.renderer.appearance, len(gaussians))
    return gaussians.joined(sphere), len(sphere)


def _decoded(scene: Scene, display: DisplayValues, factor: float, with_dome: bool) -> Splats:
    """A scene of display values as light: each colour decoded, harmonics by the slope of the decoding there.

    Light is blended where the scene blends display values, which shows where Gaussians are half transparent.
    """
    shown = display_splats(scene, None, unreported)
    if shown.dome and not with_dome:
        shown = replace(shown.rows(np.arange(len(shown) - shown.dome)), dome=0)
    harmonics = shown.harmonics.copy()
    harmonics[:, 0] = (factor * decoding.decoded(shown.colours, display) - 0.5) / C0
    harmonics[:, 1:] *= (factor * decoding.slope(shown.colours, display))[:, None]
    return replace(shown, harmonics=harmonics, linear=True, factor=factor)


def far_light_of(scene: Scene) -> Environment | None:
    """The environment of a scene as linear light, in units of linear Gaussians less their factor; None
    without one. Of display values it is what they decode to.
    """
    far = scene.renderer.environment
    if far is None:
        return None
    light = far.ln_light.detach().cpu().double().exp()
    display = scene.record.display
    if display is None:
        light = light * scene.record.normaliser
    else:
        codes = light.movedim(0, 2).numpy()
        light = torch.from_numpy(decoding.decoded(codes, display)).movedim(2, 0).clamp_min(1e-12)
    return Environment(light.log(), far.axes)


def exposure_factor(scene: Scene, factor: float) -> float:
    """Factor on the light of `Scene.render` that gives light of `factor` times the scene's own values: of a
    scene of display values those have the exposure of its photographs.
    """
    display = scene.record.display
    return factor if display is None else factor * display.k


def display_splats(scene: Scene, stops: float | None, progress: Progress, end: float = 1.0) -> Splats:
    """Convert a scene to display values: sRGB of the radiance times a factor.

    Args:
        scene: Scene of light, or of display values, which stay as they are.
        stops: log2 of the factor; None: that of splats.ply, which is taken if it shows this scene.
        progress: Callback for the current step, the steps done, and all of them.
        end: Largest code, as `Splats` has it; of a scene of display values it is 1.

    Returns:
        Gaussians of sRGB codes, with a dome where the scene has light from far away.

    Raises:
        ReconstructionError: Another exposure of a scene of display values is asked for.
        InputError: splats.ply is damaged.
    """
    record = scene.record
    factor = record.exposure if stops is None else 2.0**stops
    if record.display is not None:
        if stops is not None:
            raise ReconstructionError(
                f"{scene.folder} was trained on display values, which have the exposure of its photographs: "
                "leave --exposure out."
            )
        gaussians, dome = _with_dome(scene)
        harmonics = plain_harmonics(gaussians, scene.renderer.appearance, record.degree)
        return _splats(scene, gaussians, harmonics, False, 1.0, dome)
    path = scene.folder / SPLATS
    if stops is None and end == 1 and path.is_file() and is_stored(scene):
        file = read_ply(path)
        splats = as_splats(file, record.world, record.offset, linear=False, factor=factor)
        return replace(splats, dome=max(0, len(file) - record.gaussians))
    drawn, dome = _with_dome(scene)
    cameras: dict[str, list[SplatCamera]] = {"training": [], "validation": [], "test": []}
    for view in scene.views:
        cameras[view.use].append(record.world.camera(view.splat_camera))
    renderer = replace(scene.renderer, appearance=shown_in_colour(scene.renderer.appearance, record.bands))
    shown = display_colours(
        LitScene(scene.gaussians, renderer, record.degree, factor * record.normaliser, end),
        drawn,
        steps_after(record.iterations),
        fitted=cameras["training"],
        judged=[*cameras["validation"], *cameras["test"]],
        progress=progress,
    )
    return replace(_splats(scene, drawn, shown.harmonics, False, factor, dome), end=end)


def as_splats(
    file: PlySplats, world: WorldTransform, offset: Vector, *, linear: bool, factor: float
) -> Splats:
    """The Gaussians of a file that can be drawn, in their order.

    Args:
        file: Gaussians as a file has them: log scales, and logits of opacities.
        world: Place of the scene in the world.
        offset: What the file's coordinates leave out of those of the world.
        linear: True if the colours are radiance times `factor`, else display values.
        factor: On the radiance.

    Returns:
        Gaussians in the axes and the unit of the world; those with values that are not finite, no
        opacity, or a rotation of zeros are left out.
    """
    values = np.column_stack([file.means, file.log_scales, file.quats, file.harmonics.reshape(len(file), -1)])
    valid = np.isfinite(values).all(1) & (file.logits > -np.inf) & (np.abs(file.quats).max(1, initial=0) > 0)
    return Splats(
        means=file.means[valid],
        scales=np.exp(file.log_scales[valid]),
        quats=_unit(file.quats[valid]),
        opacities=_opacity(file.logits[valid]),
        harmonics=file.harmonics[valid],
        linear=linear,
        factor=factor,
        world=world,
        offset=offset,
    )


def rescaled(harmonics: Array, factor: float) -> Array:
    """Harmonics whose colours are those of others times a factor."""
    scaled = harmonics * factor
    scaled[:, 0] += (factor - 1) * 0.5 / C0
    return scaled


def _splats(
    scene: Scene, gaussians: Gaussians, harmonics: Array, linear: bool, factor: float, dome: int
) -> Splats:
    record = scene.record
    means, log_scales, quats, logits = (
        gaussians.parameters[name].detach().double().numpy() for name in GEOMETRY
    )
    return Splats(
        means=record.world.to_world(means) - record.offset,
        scales=np.exp(log_scales) * record.world.unit,
        quats=_unit(quats),
        opacities=_opacity(logits),
        harmonics=harmonics,
        linear=linear,
        factor=factor,
        world=record.world,
        offset=record.offset,
        dome=dome,
    )


def _unit(quats: Array) -> Array:
    largest = quats / np.abs(quats).max(axis=1, keepdims=True)
    return np.asarray(largest / np.linalg.norm(largest, axis=1, keepdims=True))


def _opacity(logits: Array) -> Array:
    return np.asarray(1 / (1 + np.exp(-logits.clip(-700, 700))))
