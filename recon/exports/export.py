"""A scene for other programs, by the name of a format; what is lost is measured on the scene."""

from collections.abc import Callable
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

from imaging.arguments import checked
from imaging.errors import InputError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.paths import scene_around
from recon.albedo.estimate import Albedo, albedo_of
from recon.exports import view_cameras
from recon.exports.formats import gltf, html, mesh, ply, sog, spz, usd
from recon.exports.job import Job, Written, blend_note
from recon.exports.loss import Loss, loss_of
from recon.exports.programs import PROGRAMS
from recon.exports.request import ExportRequest, FormatName
from recon.exports.splats import sound
from recon.exports.target_coordinates import place_of
from recon.result.scene import Scene, open_scene
from recon.result.splats.viewers import MOST_CODE

_DEFAULTS = ExportRequest()


@dataclass(frozen=True)
class Format:
    """Export format: its writer, the suffixes of its names, and the kind of light that it holds.

    linear: whether light is linear by default; end: else its largest code by default, 1 with --display.
    """

    write: Callable[[Job], Written]
    suffixes: tuple[str, ...]
    linear: bool
    end: float = 1.0
    only: str | None = None
    """Reason why the other kind of light is refused, as the middle of a sentence, or None."""


FORMATS: dict[FormatName, Format] = {
    "usd": Format(usd.write, usd.SUFFIXES, linear=True, only="is scene-linear"),
    "sog": Format(sog.write, (".sog",), linear=False, end=MOST_CODE),
    "glb": Format(gltf.write, (".glb",), linear=False),
    "spz": Format(spz.write, (".spz",), linear=False),
    "spz4": Format(spz.write_newest, (), linear=False),
    "ply": Format(ply.write, (".ply",), linear=False),
    "html": Format(
        html.write, (".html",), linear=True, only="is linear light, which it shows at any exposure"
    ),
    "points": Format(ply.write_points, (), linear=True, only="are linear light"),
    "mesh": Format(mesh.write, (), linear=True, only="is linear light"),
    "cameras": Format(view_cameras.write, (), linear=True, only="have no light"),
}

ALBEDO = (("usd", True), ("ply", True))
"""Formats that hold albedo, and whether their light is linear then."""


@dataclass(frozen=True)
class Exported:
    """Written export and its loss; None if it holds no Gaussians.

    exposure_factor: of the linear values of the file on the light of `Scene.render`, as EXR headers have it.
    brightest: largest light of a Gaussian, as a multiple of a display's white; None: any. opening: the way in
    which the program opens it, and how far that was tried, if one was named. albedo: written too, if it
    was asked for.
    """

    format: FormatName
    linear: bool
    gaussians: int
    views: int
    exposure_factor: float
    files: list[Path]
    loss: Loss | None
    brightest: float | None = None
    notes: tuple[str, ...] = field(default=())
    opening: str | None = None
    albedo: Albedo | None = None

    def data(self) -> dict[str, Any]:
        """Fields for --json."""
        return {
            "format": self.format,
            "linear": self.linear,
            "gaussians": self.gaussians,
            "views": self.views,
            "brightest": self.brightest,
            "exposure_factor": self.exposure_factor,
            "files": [str(path) for path in self.files],
            "bytes": sum(path.stat().st_size for path in self.files),
            "loss": None if self.loss is None else self.loss.data(),
            "not_in_it": list(self.notes),
            "opening": self.opening,
            "albedo_known": None if self.albedo is None else float(self.albedo.known.mean()),
        }


@checked
def export(
    scene: Scene | str | PathLike[str],
    out: str | PathLike[str],
    request: ExportRequest | FormatName = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    **options: object,
) -> Exported:
    """Write a scene as a file of another program.

    Args:
        scene: Scene, or its folder.
        out: File.
        request: Options, or the format alone.
        on_progress: Callback for the current step, the steps done, and all of them.
        options: Options by name, in place of those of `request`.

    Returns:
        The files, and the loss of light in them.

    Raises:
        InputError: The format lacks an option.
        ReconstructionError: The scene lacks data that the format needs.
        StorageError: The disk refuses.
    """
    out, request = Path(out), ExportRequest.of(request, {})
    name, linear = _asked(out, request)
    chosen = FORMATS[name]
    if linear is not None and linear != chosen.linear and chosen.only is not None:
        option = "--linear" if linear else "--display"
        raise InputError(f"{name} {chosen.only}: leave {option} out.")
    if request.albedo and (name, chosen.linear if linear is None else linear) not in ALBEDO:
        raise InputError(
            "--albedo is for linear light in .usdc, .usda and .ply: name such a file with --out, and add "
            "--linear for a .ply."
        )
    if around := scene_around(out):
        raise InputError(f"{out} is in the folder of the scene {around}: name another --out.")
    store.require_writable(out.parent)
    opened = scene if isinstance(scene, Scene) else open_scene(scene)
    if out.is_file() and opened.folder.is_file() and out.samefile(opened.folder):
        raise InputError(f"{out} is the file that is exported: name another --out.")
    finite, dropped = (opened, 0) if name == "cameras" else sound(opened)
    job = Job(
        finite,
        out,
        chosen.linear if linear is None else linear,
        request.exposure,
        place_of(finite),
        on_progress,
        chosen.end if linear is None else 1.0,
        albedo_of(finite, on_progress) if request.albedo else None,
    )
    written = chosen.write(job)
    loss = None if written.held is None else loss_of(finite, written.truth, written.held, on_progress)
    notes = written.notes
    if written.truth is not None and job.linear:
        notes = (*notes, *blend_note(finite))
    if dropped:
        notes = (*notes, f"{dropped} of {dropped + len(finite.gaussians)} Gaussians, which no renderer draws")
    return Exported(
        name,
        job.linear,
        len(finite.gaussians) if written.held is None else len(written.held),
        len(finite.views),
        job.exposure_factor,
        written.files,
        loss,
        None if written.held is None else written.held.brightest,
        notes,
        None if request.program is None else str(PROGRAMS[request.program]),
        job.albedo,
    )


def _asked(out: Path, request: ExportRequest) -> tuple[FormatName, bool | None]:
    """Format, and whether its light is linear, as a program opens it or as they were given."""
    if request.program is None:
        return request.format or format_of(out), request.linear
    program = PROGRAMS[request.program]
    suffixes = FORMATS[program.format].suffixes
    if request.format is not None or request.linear is not None or out.suffix.lower() not in suffixes:
        raise InputError(
            f"{request.program} opens {suffixes[-1]}: name such a file with --out, and leave --format, "
            "--linear and --display out."
        )
    return program.format, program.linear


def format_of(out: Path) -> FormatName:
    """Format by the extension of a file's name; InputError for an unknown one."""
    for name, format in FORMATS.items():
        if out.suffix.lower() in format.suffixes:
            return name
    ends = ", ".join(suffix for format in FORMATS.values() for suffix in format.suffixes)
    raise InputError(f"{out} does not name a format by its suffix ({ends}): name one with --format.")
