"""A trained scene opened again: rendered anywhere, or measured beside the photographs of its session."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np
import torch
from PIL import Image

from imaging.arguments import checked
from imaging.arrays import Array, Array32, Bytes
from imaging.errors import InputError, ReconstructionError
from imaging.files.photo import encode_png
from imaging.notebook import gallery
from imaging.optics.pose import upwards
from imaging.session.paths import find_reconstruction
from recon.data.world import Vector
from recon.methods import APPEARANCES
from recon.observe.photographs import Display
from recon.result.display import in_colour, picture
from recon.result.layer_names import LAYERS
from recon.result.layer_names import Layer as LayerName
from recon.result.model import CHECKPOINT, ModelRecord, SceneView, read_model
from recon.result.splats.foreign import read_splats
from recon.scene.checkpoint import Checkpoint, read_checkpoint
from recon.scene.environment import NAME as ENVIRONMENT
from recon.scene.environment import Environment
from recon.scene.gaussians import Gaussians, Renderer, limits_for
from recon.scene.sampling import Sampling
from recon.splat import Limits, Render, SplatCamera

if TYPE_CHECKING:
    from recon.result.data_layers import DataLayers

Layer = tuple[Array32, Array32 | None]
"""Light [H, W, C], and alpha [H, W] where a scene has any."""
SHOWN_WIDTH = 320
"""px of each picture that a notebook shows."""
SHOWN_STOPS = (-4.0, 0.0, 4.0)
STOPS_MOST = 100.0
"""Brighter and darker all is white and black, and float32 ends."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A trained scene: its record, its Gaussians, and how they are drawn.

    A camera is a view of the scene, by its record or its name, or a `SplatCamera`: that of a view
    (`scene.view("0000/cam0").splat_camera`), the same with other numbers (`dataclasses.replace`), or a new
    one. Poses are in the world of the calibration. Gaussians are in coordinates of the scene's own, which
    `record.world` turns into those. A scene can be given where a path to its folder can. stated: of a file of
    splats, whose coordinates are the world, what it says to add to them for those of a calibration.
    """

    folder: Path
    record: ModelRecord
    gaussians: Gaussians
    renderer: Renderer
    stated: Vector = (0.0, 0.0, 0.0)

    @property
    def left_out(self) -> Vector:
        """Offset to add to coordinates in exported files for those of the calibration."""
        return self.record.offset if any(self.record.offset) else self.stated

    @property
    def views(self) -> tuple[SceneView, ...]:
        """The cameras at their frames, in order of frame and camera."""
        return self.record.views

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels of `render`: of the bands by wavelength, else red, green and blue."""
        return tuple(band.name for band in self.record.bands) or ("red", "green", "blue")

    @property
    def exposure(self) -> float:
        """Factor on what `render` returns that shows the session as middle grey, 0.18: that of its plates."""
        return self.record.exposure

    @property
    def luminance_scale(self) -> float | None:
        """cd/m2 of the light (1, 1, 1): its luminance 0.2126 R + 0.7152 G + 0.0722 B times this is absolute.

        None where the light is relative: no reading (`rig calibrate --luminance`) says what it is.
        """
        return None if self.record.luminance is None else self.record.luminance[0]

    @property
    def luminance_error(self) -> float | None:
        """Standard error of `luminance_scale`, cd/m2."""
        return None if self.record.luminance is None else self.record.luminance[1]

    @property
    def up(self) -> Array:
        """A unit vector: the way up of the photographs together, as photographers hold their cameras."""
        return upwards([view.upright for view in self.views]) if self.views else np.array([0.0, -1.0, 0.0])

    def __fspath__(self) -> str:
        """The scene's folder: a scene stands wherever a path to it does."""
        return str(self.folder)

    def __repr__(self) -> str:
        return f"<Scene {self._summary()}>"

    @checked
    def view(self, name: str) -> SceneView:
        """Return the view of that name, `frame/camera`; ReconstructionError for an unknown one."""
        for view in self.views:
            if view.name == name:
                return view
        raise ReconstructionError(f"{self.folder} has no view {name!r}: name one as {self.views[0].name}.")

    @checked
    def drawn(self, camera: SplatCamera) -> torch.Tensor:
        """Return what a camera sees, in scene units, without gradient: float32 [H, W, channels].

        Its pose is in scene coordinates, as those of `Dataset.views`.
        """
        return self._rendered(camera).image

    @checked
    def covered(self, camera: SplatCamera) -> torch.Tensor:
        """Coverage of a picture by the scene, 0..1, float32 [H, W]; cameras are as those of `drawn`."""
        return self._rendered(camera).alpha.clamp(0, 1)

    @overload
    def render(self, camera: SplatCamera | SceneView | str) -> Array32: ...

    @overload
    def render(
        self, camera: SplatCamera | SceneView | str, *, layers: Sequence[LayerName]
    ) -> tuple[Array32, ...]: ...

    @checked
    def render(
        self, camera: SplatCamera | SceneView | str, *, layers: Sequence[LayerName] | None = None
    ) -> Array32 | tuple[Array32, ...]:
        """Render linear radiance, float32 [H, W, C]: Rec.709, or the bands of `channels`.

        layers: data that is wanted too, by name (`DataLayers`): the light and each of them is returned.

        A camera signal is this times the exposure scale of a shot (`imaging.Exposure.scale`, s), before
        vignetting and the camera's colour filters; 1 is the white of the camera.
        """
        camera = self._camera(camera)
        light = self.in_units(self.drawn(self.record.world.camera(camera)))
        if layers is None:
            return light
        for layer in layers:
            if layer not in LAYERS:
                raise InputError(f"There is no layer {layer!r:.60}: name any of {', '.join(LAYERS)}.")
        return light, *(self._data.layer(layer, camera) for layer in layers)

    @cached_property
    def _data(self) -> "DataLayers":
        from recon.result.data_layers import DataLayers

        return DataLayers(self)

    @property
    def limits(self) -> Limits:
        """The cut-offs that it is drawn by, for `rig.rasterize` of its `colours`."""
        limits = self.renderer.limits
        if limits.luminance_reference is None:
            return limits
        return replace(limits, luminance_reference=limits.luminance_reference * self.record.normaliser)

    @checked
    def colours(self, camera: SplatCamera | SceneView | str) -> torch.Tensor:
        """Colours of the Gaussians for a camera, [N, C], in the unit of `render`.

        Differentiable in the tensors of `gaussians` that require gradients. ReconstructionError for a scene
        of display values.
        """
        if self.record.display is not None:
            raise ReconstructionError(
                f"{self.folder} was trained on display values, which its Gaussians have for colours: "
                "reconstruct it with another method for light."
            )
        place = self.record.world.camera(self._camera(camera))
        return self.renderer.colours(self.gaussians, place, self.record.degree) * self.record.normaliser

    @checked
    def at(self, exposure: float = 0.0, camera: SplatCamera | SceneView | str | None = None) -> Image.Image:
        """Render a view as a display shows it: 8 bits of sRGB, clipped, in false colours of bands.

        exposure: stops; at 0 the median of the scene is middle grey. camera: None: the first view. Returns an
        image of Pillow, RGBA where the photographs had alpha. ReconstructionError for a non-finite exposure.
        """
        if not math.isfinite(exposure):
            raise ReconstructionError(
                f"A scene cannot be shown at {exposure} stops: give a number, such as 0."
            )
        camera = self._camera(self.views[0] if camera is None else camera)
        return Image.fromarray(self._shown(self.layer(camera), exposure))

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the middle view in three exposures, and what the scene is."""
        middle = self.views[len(self.views) // 2]
        camera = middle.splat_camera
        if camera.width > SHOWN_WIDTH:
            camera = camera.resized(SHOWN_WIDTH)
        layer = self.layer(camera)
        pictures = [
            (f"{middle.name}, {_signed(stops)} stops", encode_png(self._shown(layer, stops)))
            for stops in SHOWN_STOPS
        ]
        return gallery(self._summary(), pictures)

    def _shown(self, layer: Layer, exposure: float) -> Bytes:
        """A layer as a display shows it at that many stops, uint8 [H, W, 3], or RGBA where it has alpha."""
        light, alpha = layer
        factor = self.exposure * 2.0 ** float(np.clip(exposure, -STOPS_MOST, STOPS_MOST))
        with np.errstate(over="ignore"):  # what is beyond float32 is white all the same
            return picture(in_colour(light, self.record.bands), alpha, factor)

    def _summary(self) -> str:
        """The scene in a line."""
        held_out = len(self.record.held_out)
        words = [
            str(self.folder),
            self.record.settings.method,
            f"{len(self.gaussians):,} Gaussians",
            f"{len(self.views) - held_out} training views, {held_out} held out",
        ]
        if self.record.held_out_db is not None:
            words.append(f"{self.record.held_out_db:.1f} dB held out")
        if self.luminance_scale is not None:
            words.append(f"1 is {self.luminance_scale:.3g} cd/m²")
        return " · ".join(words)

    def _camera(self, camera: SplatCamera | SceneView | str) -> SplatCamera:
        if isinstance(camera, str):
            camera = self.view(camera)
        return camera.splat_camera if isinstance(camera, SceneView) else camera

    @checked
    def layer(self, camera: SplatCamera) -> Layer:
        """Render a layer for compositing: radiance as in `render`, and alpha 0..1, float32 [H, W].

        The radiance is that of the scene alone, without a background: premultiplied, as EXR has it. Alpha is
        None of a scene whose photographs had none (`ModelRecord.transparent`).
        """
        light, covered = self.covered_layer(camera)
        return light, covered if self.record.transparent else None

    def covered_layer(self, camera: SplatCamera) -> tuple[Array32, Array32]:
        """Return what `layer` has, and how much of each pixel is of Gaussians, 0..1 [H, W], of any scene."""
        render = self._rendered(self.record.world.camera(camera))
        return self.in_units(render.image), render.alpha.clamp(0, 1).numpy()

    def _rendered(self, camera: SplatCamera) -> Render:
        with torch.no_grad():
            return self.renderer(self.gaussians, camera, degree=self.record.degree)

    def in_units(self, image: torch.Tensor) -> Array32:
        """Light of `drawn` [..., C] as linear radiance in the units of the calibration, float32."""
        display = self.record.display
        if display is not None:
            image = Display(display.response, display.k, display.developed).radiance(image)
        else:
            image = image * self.record.normaliser
        return np.ascontiguousarray(image.numpy(), np.float32)


def _signed(stops: float) -> str:
    return f"{stops:+g}" if stops else "0"


@checked
def open_scene(folder: str | PathLike[str]) -> Scene:
    """Open a finished reconstruction, the newest of a session, or splats of another program.

    Args:
        folder: Folder of the reconstruction or session, a PLY, SPZ or USD file
            (`recon.result.splats.foreign`), or an open scene, which is returned as it is.

    Returns:
        The scene.

    Raises:
        ReconstructionError: The folder is neither a reconstruction nor a session with one.
        InputError: The path is missing.
    """
    if isinstance(folder, Scene):
        return folder
    folder = find_reconstruction(Path(folder))
    if folder.is_file():
        return Scene(folder, *read_splats(folder))
    record = read_model(folder)
    return scene_of(folder, record, read_checkpoint(folder / CHECKPOINT))


def scene_of(folder: Path, record: ModelRecord, checkpoint: Checkpoint) -> Scene:
    """The scene of a record and of the Gaussians and the light from far away in a checkpoint."""
    environment = Environment.stored(checkpoint.part(ENVIRONMENT))
    gaussians = Gaussians(checkpoint.part("gaussians"))
    cameras = [record.world.camera(view.splat_camera) for view in record.views if view.use == "training"]
    sampling = Sampling.of(gaussians.parameters["means"], cameras)
    appearance = APPEARANCES[record.settings.method]
    limits = limits_for(record.reference, record.display is not None)
    return Scene(folder, record, gaussians, Renderer(appearance, limits, environment, sampling))
