"""RealX3D's measure of a scene (Liu et al., arXiv 2512.23437): clean photographs of other poses, and a laser.

PSNR and SSIM of 8-bit pictures over 0..1 at the size of the photographs, means over the test views, as the
entrants of the NTIRE 2026 challenge publish them (dfgcc534/3DGS4LL, `core/evaluate.py`). What was trained on
dark photographs is dark, and no photograph states by how much: the same figures are given after one exposure
for the whole scene, the one that comes nearest to the test photographs.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from imaging import metrics
from imaging.arrays import Array32
from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.errors import InputError, ReconstructionError
from imaging.files.depth import MILLIMETRE, read_depth, require_shape
from imaging.progress import Progress, unreported
from imaging.session.session import Session
from recon.result.opened import Opened, open_model

WIDEST, FINEST = 8.0, 0.01
"""Stops: reach of the search for the exposure, and its last step. 1 / 40 of the light is 5.3."""
WHOLE = 1 << 16
"""px, wider than any photograph: none is scaled down."""


def measure(folder: Path, laser: Path | None, progress: Progress = unreported) -> dict[str, float]:
    """`score` of the test views of SESSION/reconstructions/NAME; with a laser, `depth_l1` of them, metres.

    laser: the scene's folder in `pointclouds/`. ReconstructionError if the scene has no held-out photographs;
    InputError if a file of the laser is damaged.
    """
    opened = open_model(folder, progress, WHOLE)
    views = opened.dataset.reported
    if not views or any(view.sensor.kind != "ldr" for view in views):
        raise ReconstructionError(f"{folder} has no held-out photographs: import the scene again.")
    observation, rendered = opened.training.method.observation, []
    for done, view in enumerate(views):
        progress("measuring held-out views", done, len(views))
        with torch.no_grad():
            codes = observation.predict(opened.render(view.lens), view, view.shots[0].k)
        rendered.append(codes.clamp(0, 1).numpy())
    figures = score(rendered, [view.shots[0].pixels for view in views])
    return figures if laser is None else figures | _depth_l1(opened, laser)


def score(rendered: Sequence[Array32], photographs: Sequence[Array32]) -> dict[str, float]:
    """Score views against their photographs, codes 0..1 of sRGB [H, W, 3] each; means over the views.

    `psnr` (dB) and `ssim` as they are; `psnr_exposed`, `ssim_exposed` at one exposure for all.
    """
    stops = common_exposure(rendered, photographs)
    exposed = [exposed_by(codes, stops) for codes in rendered]
    return _figures(rendered, photographs, "") | _figures(exposed, photographs, "_exposed")


def common_exposure(rendered: Sequence[Array32], photographs: Sequence[Array32]) -> float:
    """The stops at which the views together come nearest to their photographs, by the mean squared error."""
    best, step = 0.0, 1.0
    tried = np.arange(-WIDEST, WIDEST + step / 2, step)
    while step >= FINEST:
        errors = [
            sum(
                float(np.mean((exposed_by(codes, stops) - photograph) ** 2))
                for codes, photograph in zip(rendered, photographs, strict=True)
            )
            for stops in tried
        ]
        best = float(tried[int(np.argmin(errors))])
        step /= 4
        tried = best + step * np.arange(-4, 5)
    return best


def exposed_by(codes: Array32, stops: float) -> Array32:
    """Codes 0..1 of sRGB with that much more light, clipped."""
    return np.asarray(srgb_encode(srgb_decode(codes) * 2.0**stops), np.float32)


def depth_error(depth: Array32, laser: Array32) -> float | None:
    """Mean absolute difference of a depth map [H, W] to the laser's [h, w], where both are known.

    In the unit of both. Unknown is 0 of the laser, and not finite of the map; None where all is unknown.
    The pixel of the laser is the one in which the centre of the map's lies.
    """
    rows, columns = (
        ((np.arange(count) + 0.5) * there / count).astype(int)
        for count, there in zip(depth.shape, laser.shape, strict=True)
    )
    true = laser[np.ix_(rows, columns)]
    known = (true > 0) & np.isfinite(depth)
    return float(np.abs(depth[known] - true[known]).mean()) if known.any() else None


def metres_of(similarity: Path) -> float:
    """Metres in a unit of the model, by `colmap2world.npy`, a similarity [4, 4]; InputError if damaged."""
    try:
        matrix = np.load(similarity, allow_pickle=False).astype(np.float64)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{similarity} cannot be read as an array: copy it again.") from error
    scale = np.cbrt(np.linalg.det(matrix[:3, :3])) if matrix.shape == (4, 4) else np.nan
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"{similarity} is not a similarity of 4x4 numbers: copy it again.")
    return float(scale)


def _figures(rendered: Sequence[Array32], photographs: Sequence[Array32], suffix: str) -> dict[str, float]:
    rows = []
    for codes, photograph in zip(rendered, photographs, strict=True):
        written = np.rint(255 * codes) / 255
        similarity = metrics.ssim(written, photograph)
        assert similarity is not None  # no sample is masked
        rows.append((metrics.psnr(written, photograph), similarity))
    psnr, ssim = np.mean(rows, axis=0)
    return {f"psnr{suffix}": float(psnr), f"ssim{suffix}": float(ssim)}


def _depth_l1(opened: Opened, laser: Path) -> dict[str, float]:
    """Mean over the test views that the laser has a map of."""
    metres = metres_of(laser / "colmap2world.npy")
    session = Session.open(opened.dataset.session)
    sources = {shot.file: Path(shot.source or shot.file).stem for shot in session.shots("scene")}
    errors = []
    for view in opened.dataset.reported:
        file = laser / "depth" / f"{sources[view.shots[0].file]}.png"
        if not file.is_file():
            continue
        codes, _ = read_depth(file)
        require_shape(file, codes, view.lens.height, view.lens.width)
        _, depth = opened.scene.render(view.name, layers=("depth",))
        error = depth_error(depth * np.float32(metres), codes * np.float32(MILLIMETRE))
        if error is not None:
            errors.append(error)
    return {"depth_l1": float(np.mean(errors))} if errors else {}
