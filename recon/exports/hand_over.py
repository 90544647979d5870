"""The folder that a scene is handed over in: everything a compositor or a lighter opens, in one exposure.

Renders are drawn by pinholes without distortion, as USD has cameras, so that they line up with those.
"""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import PyOpenColorIO as OCIO

from imaging.arguments import checked
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr import white_luminance, write_exr
from imaging.progress import Progress, unreported
from imaging.session.paths import scene_around
from recon.exports.cameras import write_cameras
from recon.exports.formats import usd
from recon.exports.hand_over_page import page
from recon.exports.job import Job, lens_note
from recon.exports.loss import Loss, loss_of
from recon.exports.place import pinhole, place_of
from recon.exports.splats import sound
from recon.result.display import in_colour
from recon.result.scene import Scene, open_scene

SCENE, RENDERS, CAMERAS, CONFIG, PAGE = "scene.usdc", "renders", "cameras", "config.ocio", "index.html"
BUILTIN = "ocio://cg-config-v1.0.0_aces-v1.3_ocio-v2.1"
"""The configuration of OpenColorIO itself that ours is, with a rule for the renders: one that programs of
2022 read."""
LINEAR = "Linear Rec.709 (sRGB)"
"""Name there of the colour space of the renders and of the USD file."""


@dataclass(frozen=True)
class HandOver:
    """A folder that was written. loss: of the USD file."""

    folder: Path
    files: list[Path]
    gaussians: int
    factor: float
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
    if around := scene_around(folder):
        raise InputError(f"{folder} is in the folder of the scene {around}: name another --vfx.")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / PAGE).is_file():
        raise InputError(f"{folder} has files already: name a new folder, or empty it.")
    store.require_writable(folder)
    opened = scene if isinstance(scene, Scene) else open_scene(scene)
    finite, dropped = sound(opened)
    notes = lens_note(finite)
    if dropped:
        notes = (*notes, f"{dropped} Gaussians, which no renderer draws")
    with store.replacing(folder) as part:
        store.make_folder(part)
        job = Job(finite, part / SCENE, True, exposure, place_of(finite), on_progress)
        written = usd.write(job)
        assert written.held is not None
        assert written.truth is not None
        loss = loss_of(finite, written.truth, written.held, on_progress)
        renders = _write_renders(part / RENDERS, finite, job.factor, on_progress)
        cameras = write_cameras(part / CAMERAS, finite, job.place)[0] if finite.views else []
        store.write_bytes(part / CONFIG, configuration().encode())
        text = page(finite, job, loss, notes, [*written.files, *renders])
        store.write_bytes(part / PAGE, text.encode())
        files = [*written.files, *renders, *cameras, part / CONFIG, part / PAGE]
        names = [path.relative_to(part) for path in files]
    return HandOver(folder, [folder / name for name in names], len(written.held), job.factor, loss, notes)


def _write_renders(folder: Path, scene: Scene, factor: float, progress: Progress) -> list[Path]:
    """renders/CAMERA.FRAME.exr of every view, in the unit of the USD file."""
    record, files = scene.record, []
    absolute = {}
    if record.luminance is not None:
        absolute = white_luminance(*(part / factor for part in record.luminance))
    for done, view in enumerate(scene.views):
        progress("rendering", done, len(scene.views))
        light, alpha = scene.layer(pinhole(view.splat_camera))
        shown = in_colour(light, record.bands) * factor
        planes = {name: shown[..., index] for index, name in enumerate("RGB")}
        if alpha is not None:
            planes["A"] = alpha
        path = folder / f"{view.camera}.{view.frame:04d}.exr"
        header: dict[str, str | float] = {
            **absolute,
            "rig:view": view.name,
            "rig:values": f"linear radiance {record.radiance}, times {factor:.9g}",
        }
        write_exr(path, planes, attributes=header)
        files.append(path)
    return files


def configuration() -> str:
    """An OpenColorIO configuration that takes EXR files for linear Rec.709, else OpenColorIO's own."""
    config = OCIO.Config.CreateFromFile(BUILTIN)
    rules = config.getFileRules()
    rules.insertRule(0, "rig", LINEAR, "*", "exr")
    config.setFileRules(rules)
    config.setDescription(f"{BUILTIN}, with EXR files read as {LINEAR}, which the renders of rig are in.")
    config.validate()
    return str(config.serialize())
