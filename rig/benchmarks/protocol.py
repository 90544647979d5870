"""Common parts of the protocols of data sets: scenes that are found, done once each, and a table."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calib.calibrate import calibrate
from calib.request import CalibrationRequest
from capture.imports.layouts import read_layout
from capture.imports.photos import import_photos
from capture.imports.request import ImportRequest, LayoutName
from imaging.errors import InputError, RigError
from imaging.files import store
from imaging.progress import Progress
from imaging.session.calibration import read_calibration
from recon.decide.overrides import Overrides
from recon.decide.presets import MethodName, QualityName
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct

Figures = dict[str, float]


@dataclass(frozen=True)
class Choices:
    """Choices of the user. views: training views in use, evenly chosen; None: all."""

    quality: QualityName = "standard"
    seed: int = 0
    views: int | None = None

    @property
    def name(self) -> str:
        """Name of the scenes with these choices."""
        return f"{self.quality}-{self.seed}" + ("" if self.views is None else f"-{self.views}-views")


@dataclass(frozen=True)
class Column:
    """A figure in the table."""

    title: str
    digits: int


@dataclass(frozen=True)
class Protocol:
    """Protocol of a data set: training and measuring.

    is_scene: whether a folder is one of its scenes, by file names. run: from the folder of a scene and that
    of its session to its figures; what is done already is kept. columns: by the name of the figure.
    published: method and source, and its figures. note: what the figures are of, a sentence or two.
    """

    name: str
    is_scene: Callable[[Path], bool]
    run: Callable[[Path, Path, Choices, Progress], Figures]
    columns: Mapping[str, Column]
    published: Mapping[str, Figures]
    note: str


def scenes_in(protocol: Protocol, folder: Path) -> list[Path]:
    """The folder if it is a scene, else the scenes in it, by name; InputError without any."""
    if not folder.is_dir():
        raise InputError(
            f"{folder} is not a folder: name a scene of the data set, or the folder of its scenes."
        )
    if protocol.is_scene(folder):
        return [folder]
    scenes = sorted(path for path in folder.iterdir() if path.is_dir() and protocol.is_scene(path))
    if not scenes:
        raise InputError(
            f"{folder} is not a scene of {protocol.name} and contains none: give an unpacked folder of the "
            "data set."
        )
    return scenes


@dataclass(frozen=True)
class Outcome:
    """figures: of each scene that was measured, by its name; failed: why others were not."""

    figures: dict[str, Figures]
    failed: dict[str, str]

    def means(self) -> Figures:
        """Means over the scenes that have a figure."""
        keys = dict.fromkeys(key for figures in self.figures.values() for key in figures)
        values = {key: [one[key] for one in self.figures.values() if key in one] for key in keys}
        return {key: sum(each) / len(each) for key, each in values.items()}


def run_scenes(
    protocol: Protocol, scenes: list[Path], out: Path, choices: Choices, progress: Progress
) -> Outcome:
    """Train and measure scenes, each in OUT/SCENE; those that were measured with these choices are kept.

    Where one of several fails, the others are still worked on. RigError if the only one fails.
    """
    figures: dict[str, Figures] = {}
    failed: dict[str, str] = {}
    for scene in scenes:
        name = scene.resolve().name
        place = out / name
        try:
            figures[name] = _figures(protocol, scene, place, choices, progress)
        except RigError as error:
            if len(scenes) == 1:
                raise
            failed[name] = str(error)
    return Outcome(figures, failed)


def imported(scene: Path, session: Path, layout: LayoutName, progress: Progress) -> None:
    """A session of a scene's photographs and poses; one that has them is kept.

    Args:
        scene: Folder of the scene, as its data set has it.
        session: Folder of the session.
        layout: Of the data set.
        progress: Callback for the current step, the steps done, and all of them.

    Raises:
        InputError: The scene lists a photograph that is not there: its figures would be of another set.
        PartialError: A photograph cannot be read.
    """
    if not (session / "calibration" / "calibration.json").is_file():
        given = read_layout(scene, layout)
        if given is not None and given.missing:
            raise InputError(
                f"{given.missing[0]}: copy the scene again, a benchmark is of all its photographs."
            )
        import_photos(scene, session, ImportRequest(layout=layout), on_progress=progress).require_complete()


def curved(session: Path, progress: Progress) -> None:
    """Measure the response of a session's cameras by its brackets, unless that was done."""
    if all(camera.response.kind == "srgb" for camera in read_calibration(session).cameras):
        calibrate(session, CalibrationRequest(only="response"), on_progress=progress)


def trained(session: Path, method: MethodName, choices: Choices, progress: Progress) -> Path:
    """The folder of a scene, trained as was asked for."""
    return reconstruct(
        session,
        TrainingRequest(
            method=method,
            quality=choices.quality,
            seed=choices.seed,
            overrides=Overrides(views=choices.views),
            name=choices.name,
        ),
        on_progress=progress,
    )


def _figures(protocol: Protocol, scene: Path, place: Path, choices: Choices, progress: Progress) -> Figures:
    file = place / f"{choices.name}.json"
    asked: dict[str, Any] = {"protocol": protocol.name, "scene": str(scene.resolve())} | asdict(choices)
    if file.is_file():
        stored = store.read_json(file)
        if isinstance(stored, dict) and stored.get("asked") == asked:
            return {str(key): float(value) for key, value in stored["figures"].items()}
        raise InputError(f"{file} is of another scene or protocol: name another folder with --out.")
    figures = protocol.run(scene, place / "session", choices, progress)
    store.write_json(file, {"asked": asked, "figures": figures})
    return figures
