"""report.html of a reconstruction: pictures, quality, and all that led to it."""

import math
from importlib.metadata import version
from os import PathLike
from pathlib import Path

from imaging.arguments import checked
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.calibration import is_stale
from imaging.session.session import Session
from recon.result.opened import open_model
from recon.splat.torch_threads import torch_on_one_thread
from rig.report.page import Page, now, write_page
from rig.report.sections.calibrated import calibrated
from rig.report.sections.captured import captured
from rig.report.sections.comparisons import pictures
from rig.report.sections.provenance import provenance
from rig.report.sections.quality import quality, tiles


@checked
def reconstruction_report(
    folder: str | PathLike[str], *, until: float = math.inf, on_progress: Progress = unreported
) -> Path:
    """Write report.html into an evaluated reconstruction: all, from the capture to the quality.

    Args:
        folder: Reconstruction, or a session for its newest.
        until: Reading of `time.monotonic` after which no more views are drawn, and photographs read for the
            contact sheet; one of each there is always.
        on_progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The page.

    Raises:
        ReconstructionError: The reconstruction is missing or was not evaluated.
        StorageError: The disk refuses.
    """
    folder = Path(folder)
    metrics = store.read_json(folder / "metrics.json")
    opened = open_model(folder)
    session, record = Session.open(opened.dataset.session), opened.dataset.calibration
    names = session.photograph_names()
    section = quality(folder, opened.record, metrics, names)
    scale = float(metrics.get("alignment_scale", 1.0))
    with torch_on_one_thread():
        drawn = pictures(opened, scale, names, on_progress, until)
    page = Page(
        kind="Reconstruction report",
        title=session.record.name,
        lead=section.lead + ".",
        version=version("hdr-rig"),
        made=now(),
        tiles=tiles(opened.record, metrics),
        sections={
            "pictures": drawn,
            "quality": section,
            "captured": captured(session, record, on_progress, until),
            "calibrated": calibrated(session, record, is_stale(session.folder, record)),
            "provenance": provenance(
                session, record, opened.record, version("hdr-rig"), folder.resolve().name
            ),
        },
    )
    path = folder / "report.html"
    write_page(path, page)
    return path
