"""PLY: the Gaussians in the layout of 3DGS, and the bare points of a cloud."""

import numpy as np

from imaging.errors import ReconstructionError
from imaging.files import store
from recon.data.world import Vector
from recon.exports.job import Job, Written
from recon.result.splat_files import what_is_shown
from recon.scene.ply import write_ply

SOLID = 0.5
"""Opacity from which on a Gaussian counts as a point of a surface."""
_POINT = (*("x", "y", "z"), *("red", "green", "blue"))


def write(job: Job) -> Written:
    """As `rig export` does."""
    splats = job.splats()
    lines = comments(job, linear=splats.linear, factor=splats.factor, dome=splats.dome)
    write_ply(job.out, splats.gaussians(), splats.harmonics, lines, splats.world, splats.offset)
    return Written([job.out], splats.in_single(), splats if splats.linear else None)


def write_points(job: Job) -> Written:
    """The middles of what is solid, with linear float32 colours; ReconstructionError if nothing is."""
    splats = job.splats(with_dome=False)
    solid = splats.rows(splats.opacities >= SOLID)
    if not len(solid):
        raise ReconstructionError(
            f"{job.scene.folder} has no Gaussian that is at least half opaque, so there are no points: "
            "export another format."
        )
    table = np.column_stack([solid.means, solid.colours]).astype("<f4")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in comments(job, linear=True, factor=solid.factor)),
        f"element vertex {len(solid)}",
        *(f"property float {name}" for name in _POINT),
        "end_header",
    ]
    store.write_bytes(job.out, ("\n".join(header) + "\n").encode("ascii", "replace") + table.tobytes())
    notes = ["sizes, shapes and opacities, and how colours depend on the direction"]
    if left := len(splats) - len(solid):
        notes.append(f"{left} of {len(splats)} Gaussians, which are less than half opaque")
    if job.scene.renderer.environment is not None:
        notes.append("light from far away")
    return Written([job.out], notes=tuple(notes))


def comments(job: Job, *, linear: bool, factor: float, dome: int = 0) -> list[str]:
    """What the header of a file says of its colours and coordinates."""
    record = job.scene.record
    shown = what_is_shown(record.bands)
    if linear:
        lines = [f"{shown} x {factor:.6g} ({record.radiance}); not clipped, not tone-mapped"]
        if record.luminance is not None:
            value, error = (part / factor for part in record.luminance)
            absolute = f"whiteLuminance {value:.6g}: cd/m2 of (1, 1, 1) in this file"
            lines.append(f"{absolute}, standard error {error:.3g}")
    elif record.display is None:
        lines = [f"display values: sRGB of {shown} x {factor:.6g} ({record.radiance}), clipped at 1"]
    else:
        lines = ["display values, the codes of the photographs"]
    if any(record.offset):
        lines.append(_offset_line(record.offset))
    lines.append(f"coordinates: {job.place.note}")
    if dome:
        lines.append(f"light from far away: the last {dome} Gaussians, a sphere around the scene")
    return [line.encode("ascii", "replace").decode() for line in lines]


def _offset_line(offset: Vector) -> str:
    return "offset {!r} {!r} {!r}: add it to x y z".format(*offset)
