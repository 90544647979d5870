"""Loss of a scene's light in a file format, in stops, measured on the scene itself.

The Gaussians are compared as the file holds them, quantised and clipped, with those of the scene, and so are
pictures drawn of both. A stop is a factor of two in light. What is dimmer than the dimmest light that matters
counts as that.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
import numpy.typing as npt
import torch

from imaging.arrays import Array, Array32
from imaging.colour.spaces import srgb_decode
from imaging.progress import Progress
from recon.exports import decoding
from recon.exports.canvas import canvas, manners_of
from recon.exports.splats import Splats, far_light_of
from recon.exports.target_coordinates import pinhole
from recon.result.display import in_colour
from recon.result.model import SceneView
from recon.result.scene import Scene
from recon.scene.appearance import PlainHarmonics
from recon.scene.gaussians import Renderer
from recon.scene.sampling import Sampling
from recon.splat import SplatCamera

VIEWS = 4
"""Views drawn for the measurement; evenly chosen."""
_SPAN = 2.0**-20
"""Span below the brightest light that counts, where a scene does not state which light matters."""


@dataclass(frozen=True)
class Loss:
    """Differences of light, in stops, without sign.

    gaussian_median, gaussian_worst: over the channels of all Gaussians, of the mean of their colours; None of
    display values, which are not the light of single Gaussians.
    pixel_median, pixel_p99: over the channels of the pixels of some views, of those that are not clipped.
    clipped: share of these pixels with a channel brighter than the file's white.
    """

    gaussian_median: float | None
    gaussian_worst: float | None
    pixel_median: float
    pixel_p99: float
    clipped: float
    views: int

    def __str__(self) -> str:
        parts = []
        if self.gaussian_median is not None and self.gaussian_worst is not None:
            parts.append(
                f"{_span(self.gaussian_median, self.gaussian_worst, 'at worst')} of a Gaussian's light"
            )
        if self.views:
            light = "" if parts else " light"
            parts.append(
                f"{_span(self.pixel_median, self.pixel_p99, 'in the worst 1 %')} of a pixel's{light}"
            )
        if self.clipped:
            parts.append(f"{100 * self.clipped:.2g} % of the pixels are clipped at white")
        return "; ".join(parts)

    def data(self) -> dict[str, float | None]:
        """Fields for --json."""
        return asdict(self)


def loss_of(scene: Scene, truth: Splats | None, held: Splats, progress: Progress) -> Loss:
    """Return what a file lost of a scene.

    Args:
        scene: Scene that the file was written of.
        truth: The same Gaussians as `held`, in the same order, before the file's numbers held them; None of
            display values.
        held: The Gaussians of the file, as it has them.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Differences of light, in stops.
    """
    floor = floor_of(scene, linear=held.linear)
    median, worst = None, None
    if truth is not None:
        off = stops_between(truth.light, held.light, floor)
        median, worst = float(np.median(off)), float(off.max())
    views = chosen(scene.views)
    pixels, clipped = [], []
    for done, view in enumerate(views):
        progress("measuring what is lost", done, len(views))
        camera = view.splat_camera if held.linear else pinhole(view.splat_camera)
        light = _light(scene, camera, held.linear)
        brightest = np.inf if held.brightest is None else held.brightest
        white = (light * held.factor > brightest).any(2)
        clipped.append(white.mean())
        for image in _drawings(scene, held, camera):
            pixels.append(stops_between(light[~white], image[~white], floor).ravel())
    every = np.concatenate([*pixels, [0.0]] if not any(map(len, pixels)) else pixels)
    return Loss(
        median,
        worst,
        float(np.median(every)),
        float(np.quantile(every, 0.99)),
        float(np.mean(clipped)) if clipped else 0.0,
        len(views),
    )


def floor_of(scene: Scene, *, linear: bool = True) -> float:
    """The dimmest radiance that matters; of display values that of the first code of a photograph.

    linear: whether display values are decoded as the scene has them, else as a display shows them.
    """
    record = scene.record
    if record.display is not None:
        first = np.full(3, 1 / 255)
        return float((decoding.decoded(first, record.display) if linear else srgb_decode(first)).min())
    if record.reference is not None:
        return record.reference * record.normaliser
    return _SPAN / record.exposure


def stops_between(truth: npt.ArrayLike, drawn_light: npt.ArrayLike, floor: float) -> Array:
    """Return how far two lights are apart, those below `floor` counted as it."""
    both = (np.maximum(np.asarray(light, np.float64), floor) for light in (truth, drawn_light))
    return np.asarray(np.abs(np.subtract(*(np.log2(light) for light in both))))


def chosen(views: Sequence[SceneView]) -> list[SceneView]:
    """Some of the views, evenly."""
    count = min(len(views), VIEWS)
    return [views[round(place)] for place in np.linspace(0, len(views) - 1, count)]


def _light(scene: Scene, camera: SplatCamera, linear: bool) -> Array32:
    """Return what a camera in the world sees in the channels and the unit of `Splats.light`, [H, W, 3].

    linear: of display values the light of `Scene.render`, else that of a display that shows them.
    """
    display = scene.record.display
    if display is None:
        return in_colour(scene.render(camera), scene.record.bands)
    if linear:
        return scene.render(camera) * np.float32(display.k)
    codes = scene.drawn(scene.record.world.camera(camera)).numpy()
    return np.asarray(srgb_decode(codes, end=np.inf if display.developed else 1.0), np.float32)


def _drawings(scene: Scene, splats: Splats, camera: SplatCamera) -> Iterator[Array]:
    """Radiance [H, W, 3] that a camera in the world sees of a file: a picture by `rig`, or of display values
    one by each of the viewers.
    """
    if splats.linear:
        yield drawn(scene, splats, camera)
        return
    for manner in manners_of(splats.end):
        yield splats.decoded(canvas(splats, scene.record.world.camera(camera), manner)) / splats.factor


def drawn(scene: Scene, splats: Splats, camera: SplatCamera) -> Array:
    """Radiance [H, W, 3] that a camera in the world sees of the linear Gaussians of a file, by `rig`."""
    renderer = _renderer(scene, splats)
    with torch.no_grad():
        placed = scene.record.world.camera(camera)
        image = renderer(splats.gaussians(), placed, degree=min(splats.degree, 2)).image.double().numpy()
    return np.asarray(image / splats.factor)


def _renderer(scene: Scene, splats: Splats) -> Renderer:
    """Renderer of the scene for linear light in the units of a file."""
    limits = scene.renderer.limits
    far = far_light_of(scene) if not splats.dome else None
    if far is not None:  # in the units of the file, as the Gaussians
        far.ln_light = (far.ln_light + np.log(splats.factor)).float()
    if limits.luminance_reference is not None:
        unit = splats.factor * (scene.record.normaliser if scene.record.display is None else 1.0)
        limits = replace(limits, luminance_reference=limits.luminance_reference * unit)
    cameras = [scene.record.world.camera(view.splat_camera) for view in scene.views if view.use == "training"]
    sampling = Sampling.of(splats.gaussians().parameters["means"], cameras)
    return Renderer(PlainHarmonics(), limits, far, sampling)


def _span(median: float, most: float, when: str) -> str:
    if most < 0.001:
        return "less than 0.001 stops"
    middle = f"{median:.2g}" if median >= 0.001 else "less than 0.001"
    return f"{middle} stops in the median and {most:.2g} {when}"
