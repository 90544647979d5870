"""The page of a hand-over folder: what is in it, in which units, and how to open it."""

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from recon.exports.job import Job
from recon.exports.loss import Loss
from recon.result.scene import Scene
from recon.result.splats.splat_files import what_is_shown


def page(scene: Scene, job: Job, loss: Loss, notes: Sequence[str], files: Sequence[Path]) -> str:
    """The whole page, which loads nothing.

    Args:
        scene: Scene that is handed over.
        job: Export of its USD file: place, exposure and name.
        loss: Loss of light in the USD file.
        notes: What the folder does not hold, a part of a sentence each.
        files: Files of the folder so far: that of the USD and its sky, renders, and plates if there are any.

    Returns:
        HTML.
    """
    record, factor = scene.record, job.exposure_factor
    luminance = None
    if record.luminance is not None:
        value, error = (part / factor for part in record.luminance)
        luminance = (f"{value:.4g}", f"{error:.2g}")
    escaping = Environment(
        loader=PackageLoader("recon.exports"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        finalize=lambda value: escape(str(value)),
    )
    return escaping.get_template("hand_over.html").render(
        name=scene.folder.resolve().name,
        shown=what_is_shown(record.bands),
        radiance=record.radiance,
        factor=f"{factor:.6g}",
        stops=f"{math.log2(factor):+.2f}",
        luminance=luminance,
        place=job.place,
        offset=", ".join(map(repr, scene.left_out)) if any(scene.left_out) else "",
        gaussians=f"{len(scene.gaussians):,}",
        degree=record.degree,
        cameras=", ".join(sorted({view.camera for view in scene.views})),
        frames=sorted({view.frame for view in scene.views}),
        loss=loss,
        notes="; ".join(notes),
        plates=any(path.parent.name == "plates" for path in files),
        upright=any(view.lens.height > view.lens.width for view in scene.views),
        sky=next((p.name for p in files if p.suffix == ".exr" and p.parent == job.out.parent), None),
    )
