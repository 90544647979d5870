"""The light of scenes for the camera of a browser: which scene, through which lens, which parts of it."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from imaging.arrays import Array32
from imaging.files.exr.reading import read_exr
from imaging.optics.pose import picture_as_held
from recon.rendering.light_files import stem
from recon.result.data_layers import DataLayers
from recon.result.display import in_colour
from recon.result.scene import Scene
from recon.splat import SplatCamera
from rig.view.pictures.layers import LAYERS, LayerName
from rig.view.pictures.residuals import Residuals, residuals_of

RENDER, REFERENCE, DIFFERENCE = "render", "reference", "difference"
FIRST, SECOND, SPLIT, OVER = "A", "B", "A | B", "B over A"


@dataclass(frozen=True)
class Parts:
    """Parts of the model that are drawn. degree: of the harmonics at most; None: that of each scene."""

    environment: bool = True
    degree: int | None = None

    def of(self, scene: Scene) -> Scene:
        """The scene with these parts alone."""
        if not self.environment and scene.renderer.environment is not None:
            scene = replace(scene, renderer=replace(scene.renderer, environment=None))
        if self.degree is not None and self.degree < scene.record.degree:
            scene = replace(scene, record=scene.record.model_copy(update={"degree": self.degree}))
        return scene


@dataclass(frozen=True)
class Wanted:
    """Requested picture. show: one of the names above. view: whose lens is used, `frame/camera`; None: a free
    camera.

    camera: in the coordinates of the first scene.
    """

    show: str
    view: str | None
    camera: SplatCamera
    parts: Parts = Parts()

    @property
    def key(self) -> object:
        """Equal for what looks the same."""
        camera = self.camera
        size = camera.width, camera.height
        return self.show, self.view, camera.cam_from_world.tobytes(), camera.lens, size, self.parts


@dataclass(frozen=True, eq=False)
class Drawing:
    """light: linear Rec.709 [H, W, 3], which a spot meter measures; over: what it is compared with;
    layer: of `rig.view.pictures.layers`, which is shown in its place."""

    light: Array32
    over: Array32 | None = None
    layer: Array32 | None = None


class Painter:
    """Draws one scene, or two to compare. drawing: held meanwhile, since the kernels share all cores."""

    def __init__(self, *scenes: Scene) -> None:
        self.scenes: tuple[Scene, ...] = scenes
        self.drawing = threading.Lock()
        self._data = DataLayers(scenes[0])
        self._residuals: dict[Scene, Residuals | None] = {}

    @property
    def scene(self) -> Scene:
        """The first, whose coordinates, views and exposure are those of the page."""
        return self.scenes[0]

    @property
    def references(self) -> Mapping[str, Path]:
        """References of the first scene, as far as they exist: an evaluation may still be writing them."""
        return references(self.scene)

    def turn_to(self, scene: Scene) -> None:
        """Draw a later state of the one scene from now on."""
        with self.drawing:
            self.scenes, self._data = (scene,), DataLayers(scene)
            self._residuals.clear()

    def residuals(self, number: int = 0) -> Residuals | None:
        """Return how far a scene, by its number, is off held-out photographs, which are read once."""
        scene = self.scenes[number]
        with self.drawing:
            if scene not in self._residuals:
                self._residuals[scene] = residuals_of(scene)
            return self._residuals[scene]

    def shows(self, view: str | None) -> tuple[str, ...]:
        """Return the layers that a view, or a free camera, offers."""
        if len(self.scenes) > 1:
            return (FIRST, SECOND, SPLIT, OVER, *((REFERENCE,) if view in self.references else ()))
        return (RENDER, *((REFERENCE, DIFFERENCE) if view in self.references else ()), *LAYERS)

    def placed(self, view: str) -> SplatCamera:
        """A view's camera in the coordinates of the first scene."""
        return self.scene.record.world.camera(self.scene.view(view).splat_camera)

    def warm_up(self) -> None:
        """Load what draws, or compile it, once on a machine, by a picture of next to nothing."""
        camera = self.scene.record.world.camera(self.scene.views[0].splat_camera)
        for scene in self.scenes:
            scene.drawn(camera.resized(16))

    def draw(self, wanted: Wanted) -> Drawing:
        """Return what is to be seen, of a view upright: drawn by its stored camera, and then turned."""
        if wanted.show == REFERENCE:
            return Drawing(self._reference(wanted))
        if wanted.show == SECOND:
            return Drawing(self._light(1, wanted))
        light = self._light(0, wanted)
        if wanted.show in LAYERS:
            return Drawing(light, layer=self._layer(wanted))
        if wanted.show == DIFFERENCE:
            return Drawing(light, resized(self._reference(wanted), light))
        if wanted.show in (SPLIT, OVER):
            other = resized(self._light(1, wanted), light)
            if wanted.show == OVER:
                return Drawing(other, light)
            middle = light.shape[1] // 2
            return Drawing(np.concatenate([light[:, :middle], other[:, middle:]], axis=1))
        return Drawing(light)

    @property
    def trust_is_known(self) -> bool:
        """Return whether the views were drawn already, which takes a picture each."""
        return "photographs" in vars(self._data)

    def _reference(self, wanted: Wanted) -> Array32:
        assert wanted.view is not None
        return picture_as_held(read_light(self.references[wanted.view]), self._orientation(wanted))

    def _layer(self, wanted: Wanted) -> Array32:
        camera = self.scene.record.world.camera_in_world(wanted.camera)
        with self.drawing:
            layer = self._data.layer(cast(LayerName, wanted.show), camera)
        return picture_as_held(layer, self._orientation(wanted))

    def _light(self, number: int, wanted: Wanted) -> Array32:
        scene = self.scenes[number]
        orientation = self._orientation(wanted)
        camera = self.scene.record.world.camera_in_world(wanted.camera)
        if number and wanted.view in {view.name for view in scene.views}:
            view = scene.view(str(wanted.view))
            camera = view.splat_camera
            if view.shots and self.scene.view(view.name).shots:  # a file of splats states no orientation
                orientation = view.orientation
        with self.drawing:
            light = in_colour(wanted.parts.of(scene).render(camera), scene.record.bands)
        return picture_as_held(light, orientation)

    def _orientation(self, wanted: Wanted) -> int:
        """Orientation of a view of the first scene; 1 of a free camera, whose picture stays as it is."""
        return 1 if wanted.view is None else self.scene.view(wanted.view).orientation


def compared_with(show: str) -> str:
    """Return what the light of a drawing is compared with, in words."""
    return "A" if show == OVER else "the reference"


def measured(show: str, column: int, width: int) -> int | None:
    """Return the number of the scene whose light a column of a drawing has; None: that of a photograph."""
    if show == REFERENCE:
        return None
    return int(show in (SECOND, OVER) or (show == SPLIT and column >= width // 2))


def references(scene: Scene) -> Mapping[str, Path]:
    """The light of views that `rig evaluate` measured the scene by, EXR by name of the view."""
    folder = scene.folder / "references"
    paths = {view.name: folder / f"{stem(view)}.exr" for view in scene.views}
    return {name: path for name, path in paths.items() if path.is_file()}


def read_light(path: Path) -> Array32:
    """Linear light of an EXR, float32 [H, W, 3]."""
    return np.asarray(read_exr(path).rgb(), np.float32)


def resized(light: Array32, like: Array32) -> Array32:
    """Light in the size of other light."""
    if light.shape == like.shape:
        return light
    return np.asarray(cv2.resize(light, like.shape[1::-1], interpolation=cv2.INTER_AREA), np.float32)
