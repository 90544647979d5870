"""The folder that a scene is handed over in: everything a compositor or a lighter opens, in one exposure.

Renders are drawn by pinholes without distortion, as USD has cameras, so that they line up with those.
"""

import re
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import PyOpenColorIO as OCIO

from imaging.arguments import checked
from imaging.errors import InputError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.paths import scene_around
from recon.exports.formats import alembic, nuke, usd
from recon.exports.hand_over_page import page
from recon.exports.job import Job, blend_note, lens_note
from recon.exports.loss import Loss, loss_of
from recon.exports.plates import AS_SHOT, LENSES, PLATES, Plates, write_plates
from recon.exports.splats import sound
from recon.exports.target_coordinates import pinhole, place_of
from recon.exports.view_cameras import write_cameras
from recon.rendering.light_files import header_of, seen_by, write_light
from recon.result.display import in_colour
from recon.result.model import ENVIRONMENT
from recon.result.scene import Scene, open_scene
from recon.splat import SplatCamera

SCENE, RENDERS, CAMERAS, CONFIG, PAGE = "scene.usdc", "renders", "cameras", "config.ocio", "index.html"
WRITTEN = {
    SCENE, f"{Path(SCENE).stem}.{ENVIRONMENT}", RENDERS, PLATES, AS_SHOT, LENSES, CAMERAS, CONFIG, PAGE,
    nuke.SCRIPT,
}  # fmt: skip
"""Names of all that a hand-over can have in its folder."""
ALEMBIC = "cameras.abc"
BUILTIN = "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1"
"""The configuration of OpenColorIO itself that ours is, with a rule for the renders: one that programs of
2022 read."""
LINEAR = "Linear Rec.709 (sRGB)"
"""Name there of the colour space of the renders and of the USD file."""
NAMES = {LINEAR: "lin_rec709_scene", "ACEScg": "lin_ap1_scene", "ACES2065-1": "lin_ap0_scene", "Raw": "data"}
"""Colour spaces of the configuration, and the names of the Color Interop Forum, which our files state."""


@dataclass(frozen=True)
class HandOver:
    """A folder that was written. loss: of the USD file."""

    folder: Path
    files: list[Path]
    gaussians: int
    exposure_factor: float
    loss: Loss
    notes: tuple[str, ...]


@checked
def hand_over(
    scene: Scene | str | PathLike[str],
    folder: str | PathLike[str],
    *,
    exposure: float | None = None,
    on_progress: Progress = unreported,
) -> HandOver:
    """Write a folder for compositing: USD, EXR of the views, cameras, an OpenColorIO configuration, a page.

    Args:
        scene: Scene, or its folder.
        folder: Folder to write.
        exposure: Stops, all light is multiplied by 2^exposure; None: chosen so that the median is middle
            grey.
        on_progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The files, and the loss of light in the USD file.

    Raises:
        InputError: The folder has foreign files.
        StorageError: The disk refuses.
    """
    folder = Path(folder)
    place = folder.resolve()  # a link to a folder stays one
    if around := scene_around(folder):
        raise InputError(f"{folder} is in the folder of the scene {around}: name another --vfx.")
    _require_replaceable(place, folder)
    store.require_writable(place)
    opened = scene if isinstance(scene, Scene) else open_scene(scene)
    finite, dropped = sound(opened)
    notes = (*lens_note(finite), *blend_note(finite))
    if dropped:
        notes = (*notes, f"{dropped} Gaussians, which no renderer draws")
    with store.replacing(place) as part:
        store.make_folder(part)
        job = Job(finite, part / SCENE, True, exposure, place_of(finite), on_progress)
        written = usd.write(job)
        assert written.held is not None
        assert written.truth is not None
        loss = loss_of(finite, written.truth, written.held, on_progress)
        plates = write_plates(part, finite, job.exposure_factor, on_progress)
        renders = _write_renders(part / RENDERS, finite, job.exposure_factor, plates, on_progress)
        notes = (*notes, *plates.notes)
        if finite.views and not alembic.has_alembic():
            notes = (*notes, "cameras as Alembic, which need pip install -e '.[alembic]'")
        cameras = _write_cameras(part, job, plates) if finite.views else []
        store.write_bytes(part / CONFIG, configuration([view.camera for view in finite.views]).encode())
        text = page(finite, job, loss, notes, [*written.files, *renders, *plates.files])
        store.write_bytes(part / PAGE, text.encode())
        files = [*written.files, *renders, *plates.files, *cameras, part / CONFIG, part / PAGE]
        names = [path.relative_to(part) for path in files]
    return HandOver(
        folder, [folder / name for name in names], len(written.held), job.exposure_factor, loss, notes
    )


def _require_replaceable(place: Path, folder: Path) -> None:
    """InputError unless there is nothing yet, an empty folder, or a hand-over with nothing beside it."""
    if not place.exists():
        return
    if not place.is_dir():
        raise InputError(f"{folder} is a file, and a hand-over fills a folder: name another --vfx.")
    names = sorted(path.name for path in place.iterdir())
    foreign = [name for name in names if name not in WRITTEN]
    if not foreign and names and not {SCENE, CONFIG} <= set(names):
        foreign = names
    if foreign:
        raise InputError(
            f"{folder} has files already, such as {foreign[0]}, which are not of a hand-over: name a new "
            "folder, or empty it."
        )


def _write_renders(
    folder: Path, scene: Scene, factor: float, plates: Plates, progress: Progress
) -> list[Path]:
    """renders/CAMERA.FRAME.exr of every view, in the unit of the USD file, as large as its plate."""
    record, files = scene.record, []
    for done, view in enumerate(scene.views):
        progress("rendering", done, len(scene.views))
        size = plates.sizes.get(view.camera, (view.lens.width, view.lens.height))
        camera = pinhole(SplatCamera.of(view.lens.resized(*size), view.cam_from_world))
        light, alpha = scene.layer(camera)
        path = folder / f"{view.camera}.{view.frame:04d}.exr"
        header = header_of(record, view.name, factor) | seen_by(camera)
        write_light(path, in_colour(light, record.bands) * np.float32(factor), header, alpha=alpha)
        files.append(path)
    return files


def _write_cameras(folder: Path, job: Job, plates: Plates) -> list[Path]:
    """cameras/ for other programs, a .chan of each, and the script of Nuke where there are plates."""
    scene = job.scene
    files = write_cameras(folder / CAMERAS, scene, job.place)[0]
    if alembic.has_alembic():
        files.append(folder / CAMERAS / ALEMBIC)
        alembic.write_cameras(files[-1], scene, job.place)
    texts = {f"{CAMERAS}/{name}.chan": text for name, text in nuke.chan_files(scene, job.place).items()}
    named = {path.name.rsplit(".", 2)[0] for path in plates.files if path.parent.name == PLATES}
    if named:
        texts[nuke.SCRIPT] = nuke.script(scene, sorted(named))
    for name, text in texts.items():
        store.write_bytes(folder / name, text.encode())
    return [*files, *(folder / name for name in texts)]


def configuration(cameras: Sequence[str]) -> str:
    """OpenColorIO's own configuration, with the names of colour spaces that our files state, and rules for
    the files of a hand-over of these cameras, by folder and name; for any other those of OpenColorIO.
    """
    before = OCIO.GetLoggingLevel()
    OCIO.SetLoggingLevel(OCIO.LOGGING_LEVEL_WARNING)  # it names displays of its own that it has switched off
    try:
        return _configured(OCIO.Config.CreateFromFile(BUILTIN), cameras)
    finally:
        OCIO.SetLoggingLevel(before)


def _configured(config: OCIO.Config, cameras: Sequence[str]) -> str:
    for name, alias in NAMES.items():
        space = deepcopy(config.getColorSpace(name))
        if not config.hasRole(alias):  # by which it is known already
            space.addAlias(alias)
        config.addColorSpace(space)
    rules, named = config.getFileRules(), "|".join(map(re.escape, sorted(set(cameras))))
    frame = rf"({named})\.\d+\.exr"
    rules.insertRule(0, "rig", LINEAR, rf"(.*[/\\])?({RENDERS}|{PLATES}|{AS_SHOT})[/\\]{frame}")
    rules.insertRule(1, "rig lens", "Raw", rf"(.*[/\\])?{LENSES}[/\\]({named})\.(un|re)distort\.exr")
    rules.insertRule(2, "rig far", LINEAR, rf"(.*[/\\])?{Path(SCENE).stem}\.{re.escape(ENVIRONMENT)}")
    config.setFileRules(rules)
    config.setDescription(f"{BUILTIN}, with the files of this hand-over read as {LINEAR}.")
    config.validate()
    return str(config.serialize())
