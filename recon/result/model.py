"""`model.json`: what was trained, from what, with which choices, and all that its pictures need."""

from datetime import datetime
from pathlib import Path
from typing import Literal

from pydantic import Field

from imaging.arrays import Array
from imaging.errors import ReconstructionError
from imaging.files import store
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose, as_held
from imaging.record import Record, parse
from imaging.session.calibration import CalibrationRecord, Response
from imaging.session.records import Band, Name, Rung
from imaging.session.view_id import ViewId
from recon.data.world import Vector, WorldTransform
from recon.decide.cost.prediction import Prediction
from recon.decide.settings import Settings
from recon.splat import SplatCamera

MODEL = "model.json"
CALIBRATION = "calibration.json"
"""The calibration as the scene was trained on it, whatever becomes of the session's."""
CHECKPOINT = "checkpoint.safetensors"
SPLATS = "splats.ply"
"""Name of the file for viewers."""
RADIANCE = "radiance.ply"
"""Name of the file in linear light."""
ENVIRONMENT = "environment.exr"
"""Light from far away, where the scene has some: a map of latitude and longitude."""
LOG = "train.jsonl"
REFINEMENT = "refinement.json"


Use = Literal["training", "validation", "test"]


class SceneShot(Record):
    """One photograph of a view."""

    file: str
    """Relative to the session."""
    k: float = Field(gt=0)
    """Exposure scale, s, as training corrected it: camera signal = radiance x k."""
    noise: tuple[float, float] | None = None
    """Slope and floor of the variance of its signal, white at 1 (RAW alone); None if unknown."""
    measures: tuple[float, float] | None = None
    """Least and most linear radiance that it measures above its noise and below white (`measured_light`);
    None if unknown.
    """


class SceneView(Record):
    """A camera at a frame, as the scene has it."""

    camera: Name
    frame: int = Field(ge=0)
    use: Use
    """validation: held out, and the training could be ended by it; figures are of the test views."""
    lens: Lens
    """Lens of the training images, px."""
    cam_from_world: Pose
    """Pose as corrected by training."""
    shots: tuple[SceneShot, ...]
    """Shots in use, darkest first."""
    cfa: tuple[str, ...] = ()
    """Rows of the tile of its colour filters (`imaging.sensor.cfa`); empty: not trained as a mosaic."""
    orientation: int = Field(default=1, ge=1, le=8)
    """Orientation that EXIF states of its first photograph; lens and pose are of the picture as stored."""

    @property
    def id(self) -> ViewId:
        """Identity of the view."""
        return ViewId(self.frame, self.camera)

    @property
    def name(self) -> str:
        """`frame/camera`."""
        return str(self.id)

    @property
    def upright(self) -> Array:
        """The motion from the world into the axes of the upright picture, float64 [4, 4]."""
        return as_held(self.cam_from_world.matrix(), self.orientation)

    @property
    def splat_camera(self) -> SplatCamera:
        """Camera that draws it; `dataclasses.replace` makes a camera of another pose or lens of it."""
        return SplatCamera.of(self.lens, self.cam_from_world)


class DisplayValues(Record):
    """Conversion of display values to light: the inverse of the response, over `k`.

    developed: as `recon.observe.photographs.Display` has it.
    """

    response: Response
    k: float = Field(gt=0)
    developed: bool = False


class ModelRecord(Record):
    """`model.json`, written when the training is done.

    It renders without the session: views, lenses, poses and the scale of the light are in it.
    """

    schema_version: Literal[1] = 1
    created: datetime
    versions: dict[str, str]
    settings: Settings
    session: str
    """Name of the session that it was trained on."""
    photographs_sha256: str
    """Hash of the names and hashes of the shots of all views and of their masks
    (`dataset.photographs_sha256`)."""
    calibration_sha256: str
    """Hash of the session's calibration.json (and split.json) as it was trained on."""
    normaliser: float
    """Linear radiance, in the units of the calibration, that is 1 in scene units."""
    reference: float | None
    """The dimmest radiance that matters, in scene units."""
    display: DisplayValues | None
    """Conversion to light; None: scene units times `normaliser` are linear radiance."""
    radiance: str
    """Gauge of the radiance: the unit that it is relative to."""
    luminance: tuple[float, float] | None = None
    """Luminance in cd/m2 of linear radiance (1, 1, 1), and its standard error; None: the calibration has no
    scale, or not for all cameras, or training did not keep to the unit of the calibration (a learned curve,
    display values).
    """
    world: WorldTransform
    """Transform from the scene to the world of the calibration: `views` are in the world, the checkpoint is
    in the scene's coordinates.
    """
    offset: Vector
    """World coordinates are those of the PLY files plus this: zeros, where float32 holds them as they are."""
    exposure: float = Field(gt=0)
    """Factor on linear radiance that shows it as middle grey: that of its session (`exposure_of`)."""
    display_db: float | None
    """PSNR of splats.ply as a viewer draws it, against the light as a display shows it; None of a scene that
    was trained on display values, which are in splats.ply as they are."""
    degree: int = Field(ge=0, le=2)
    """Degree of the harmonics."""
    bands: tuple[Band, ...]
    """Channels of the light, by wavelength; empty: those of Rec.709."""
    transparent: bool = False
    """True if photographs had alpha, which the scene then has too: an object without a background."""
    views: tuple[SceneView, ...]
    """Views in order of frame and camera."""
    gaussians: int
    train_seconds: float
    device: str
    """The GPU's name, or how many threads of the CPU."""
    loss: float | None
    """The last that was logged; None if it was interrupted before there was any."""
    rungs: tuple[Rung, ...]
    iterations: int
    """Iterations done."""
    schedule: tuple[tuple[int, float], ...]
    """The schedule as it came: straight lines through (iteration, position), which is up to
    `settings.iterations`. The same settings with this schedule give the same bytes on any machine."""
    ending: Literal["schedule", "early stop", "goal", "interrupted"]
    """Reason for the end: as planned, quality stood still, quality was reached, or the user stopped it (the
    checkpoint can then be continued).
    """
    held_out_db: float | None
    """The end of the live curve, of the validation views if there are any; None where no view is held out."""
    measuring_seconds: float
    """Seconds of the live curve, beside `train_seconds`."""
    predicted: Prediction | None
    """Prediction of `held_out_db`."""

    @property
    def width(self) -> int:
        """Width of the widest training images, px."""
        return max(view.lens.width for view in self.views)

    @property
    def training_views(self) -> tuple[str, ...]:
        """Names of the views that were trained on."""
        return tuple(view.name for view in self.views if view.use == "training")

    @property
    def held_out(self) -> tuple[str, ...]:
        """Names of the views that it was not trained on, for validation and for testing."""
        return tuple(view.name for view in self.views if view.use != "training")

    @property
    def validation(self) -> tuple[str, ...]:
        """Names of those of the held-out views that could end the training."""
        return tuple(view.name for view in self.views if view.use == "validation")


def read_model(folder: Path) -> ModelRecord:
    """Read the model.json of a finished reconstruction; ReconstructionError if it is missing."""
    path = folder / MODEL
    if not path.is_file():
        raise ReconstructionError(f"{folder} holds no finished reconstruction: run `rig reconstruct` first.")
    return parse(ModelRecord, store.read_json(path), path)


def read_own_calibration(folder: Path) -> CalibrationRecord:
    """The calibration that a scene was trained on; InputError if its copy is missing or damaged."""
    path = folder / CALIBRATION
    return parse(CalibrationRecord, store.read_json(path), path)
