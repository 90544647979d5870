"""PLY: the Gaussians in the layout of 3DGS, and the bare points of a cloud."""

import numpy as np

from imaging.arrays import Array
from imaging.errors import ReconstructionError
from imaging.files import store
from recon.albedo.estimate import Albedo
from recon.data.world import Vector
from recon.exports.formats.vertices import packed_vertices, shown
from recon.exports.job import Job, Written
from recon.result.splats.splat_files import BLENDED, what_is_shown
from recon.scene.ply import write_ply

SOLID = 0.5
"""Opacity from which on a Gaussian counts as a point of a surface."""

ALBEDO_LINES = [
    "albedo_r, albedo_g, albedo_b: reflectance 0..1, linear; albedo_sigma: standard error of their mean",
    "irradiance_r, irradiance_g, irradiance_b: pi x radiance / albedo, in the unit of the radiance",
    "nan: not known",
]


def albedo_columns(albedo: Albedo, factor: float, dome: int = 0) -> dict[str, Array]:
    """Return the properties [N + dome] that an albedo adds to a file; factor: on its irradiance."""
    parts = {"albedo": albedo.albedo, "irradiance": albedo.irradiance * factor}
    columns = {
        f"{name}_{channel}": values[:, number]
        for name, values in parts.items()
        for number, channel in enumerate("rgb")
    } | {"albedo_sigma": albedo.sigma}
    return {name: np.pad(values, (0, dome), constant_values=np.nan) for name, values in columns.items()}


def write(job: Job) -> Written:
    """Write the file, as a writer of `rig export`."""
    splats = job.splats()
    lines = comments(job, linear=splats.linear, factor=splats.factor, dome=splats.dome)
    if job.albedo is not None:
        lines += ALBEDO_LINES
    more = {} if job.albedo is None else albedo_columns(job.albedo, splats.factor, splats.dome)
    write_ply(
        job.out,
        splats.gaussians(),
        splats.harmonics,
        lines,
        splats.world,
        splats.offset,
        normals=True,
        more=more,
    )
    return Written([job.out], splats.in_single(), splats if splats.linear else None)


def write_points(job: Job) -> Written:
    """The middles of what is solid, in colours of screens and as light; ReconstructionError if nothing is."""
    splats = job.splats(with_dome=False)
    solid = splats.rows(splats.opacities >= SOLID)
    if not len(solid):
        raise ReconstructionError(
            f"{job.scene.folder} has no Gaussian that is at least half opaque, so there are no points: "
            "export another format."
        )
    light = solid.light * solid.factor
    store.write_bytes(job.out, packed_vertices(solid.means, shown(light), vertex_comments(job), light=light))
    notes = ["sizes, shapes and opacities, and how colours depend on the direction"]
    if omitted := len(splats) - len(solid):
        notes.append(f"{omitted} of {len(splats)} Gaussians, which are less than half opaque")
    if job.scene.renderer.environment is not None:
        notes.append("light from far away")
    return Written([job.out], notes=tuple(notes))


def comments(job: Job, *, linear: bool, factor: float, dome: int = 0) -> list[str]:
    """Return what the header of a file says of its colours and coordinates.

    Args:
        job: Export, whose scene and place are described.
        linear: True if the colours are radiance, else display values.
        factor: On the radiance, in the file.
        dome: Number of the last Gaussians, which represent light from far away; 0 without them.

    Returns:
        Lines of ASCII.
    """
    record = job.scene.record
    what = what_is_shown(record.bands)
    if linear:
        lines = [f"{what} x {factor:.6g} ({record.radiance}); not clipped, not tone-mapped"]
        if record.luminance is not None:
            value, error = (part / factor for part in record.luminance)
            absolute = f"whiteLuminance {value:.6g}: cd/m2 of (1, 1, 1) in this file"
            lines.append(f"{absolute}, standard error {error:.3g}")
    elif record.display is None:
        lines = [f"display values: sRGB of {what} x {factor:.6g} ({record.radiance}); {BLENDED}"]
    else:
        lines = ["display values, the codes of the photographs"]
    if any(job.scene.left_out):
        lines.append(offset_line(job.scene.left_out))
    lines.append(f"coordinates: {job.place.note}")
    if dome:
        lines.append(f"light from far away: the last {dome} Gaussians, a sphere around the scene")
    return [line.encode("ascii", "replace").decode() for line in lines]


def vertex_comments(job: Job) -> list[str]:
    """The same of vertices that have colours of both kinds."""
    first, *others = comments(job, linear=True, factor=job.factor)
    return [
        "red, green, blue: display values, sRGB of the light, clipped at 1",
        f"radiance_red, radiance_green, radiance_blue: {first}",
        *others,
    ]


def offset_line(offset: Vector) -> str:
    """Return what coordinates lack, as a comment."""
    return "offset {!r} {!r} {!r}: add it to x y z".format(*offset)
