"""SPZ: what displays show, in 8 bits."""

from dataclasses import replace

import numpy as np

from imaging.errors import InputError
from imaging.files import store
from recon.exports.formats.order import along_curve
from recon.exports.job import Job, Written
from recon.exports.loss import floor_of, stops_between
from recon.exports.splats import Splats, as_splats
from recon.scene.spz import BRIGHTEST, Version, pack, unpack

_TOO_FAR = 1 / 3
"""Stops."""


def write(job: Job, version: Version = 3) -> Written:
    """Write the file, as a writer of `rig export`; InputError for linear light."""
    splats = job.splats()
    data, held = packed_splats(splats.rows(along_curve(splats.means)), version)
    if job.linear:
        light = splats.rows(along_curve(splats.means)).light
        share = np.mean(stops_between(light, held.light, floor_of(job.scene)) > _TOO_FAR)
        raise InputError(
            f"SPZ holds colours up to {BRIGHTEST:.2f} in 8 bits, so {100 * share:.0f} % of the linear light "
            f"of {job.scene.folder} would be off by more than a third of a stop: leave --linear out, or "
            "name a .usdc or a .sog."
        )
    store.write_bytes(job.out, data)
    return Written([job.out], held)


def write_newest(job: Job) -> Written:
    """Write version 4, of which `write` says the rest."""
    return write(job, 4)


def packed_splats(splats: Splats, version: Version = 3) -> tuple[bytes, Splats]:
    """The file of some Gaussians, and these as it has them."""
    data = pack(
        splats.means, np.log(splats.scales), splats.quats, splats.opacities, splats.harmonics, version
    )
    unpacked = as_splats(
        unpack(data), splats.world, splats.offset, linear=splats.linear, factor=splats.factor
    )
    return data, replace(unpacked, dome=splats.dome)
