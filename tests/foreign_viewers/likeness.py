"""How closely viewers show what `rig export` says of its files."""

from pathlib import Path

import numpy as np

from imaging.arrays import Array
from imaging.colour.spaces import srgb_decode
from recon.exports.canvas import Manner, canvas
from recon.exports.export import export
from recon.exports.loss import stops_between
from recon.exports.splats import as_splats
from recon.result.scene import Scene
from recon.scene.ply_file import read_ply
from tests.foreign_viewers.viewers import Viewer
from tests.foreign_viewers.wall import front

FAINT = 1 / 1024


def loss_is_shown(scene: Scene, viewer: Viewer, file: Path, turn: Array | None) -> None:
    """Assert that a picture of an exported file is off by the loss that the export states."""
    exported = export(scene, file, exposure=0.0)
    shown = srgb_decode(viewer.drawn(file, front(), turn=turn) / 255)
    light = scene.render(front())
    dim = (light < 0.95).all(2)
    off = stops_between(light[dim], shown[dim], FAINT)
    assert exported.loss is not None
    assert np.median(off) < exported.loss.pixel_median + 0.015
    assert np.median(off) < 0.12


def canvas_is_shown(scene: Scene, viewer: Viewer, file: Path, manner: Manner) -> None:
    """Assert that a picture of a PLY file is the canvas that its loss is measured on."""
    export(scene, file, exposure=0.0)
    world, offset = scene.record.world, scene.record.offset
    splats = as_splats(read_ply(file), world, offset, linear=False, factor=1.0)
    painted = 255 * canvas(splats, world.camera(front()), manner)
    off = np.abs(viewer.drawn(file, front()) - painted)
    assert np.median(off) < 1
    assert off.mean() < 1.5
