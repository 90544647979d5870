"""Depth maps of a simulated session as a scanner of some noise would have measured them."""

from pathlib import Path

import cv2
import numpy as np

from drivers.sim.rigs import simulate
from imaging.arrays import Array
from imaging.files import store
from imaging.files.depth import MILLIMETRE
from imaging.files.photo import encode_png
from imaging.session.session import Session
from recon.data.dataset import Dataset, View
from recon.data.geometry import rays
from recon.data.load import load

BLOB = 0.04
"""Size of a hole, in widths of the picture."""


def true_depth(dataset: Dataset, view: View) -> Array:
    """Depth along the axis of a simulated view at every pixel, in units of the world, [H, W]."""
    lens = view.lens
    pixels = np.stack(np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5), -1)
    directions = rays(lens, pixels) @ lens.cam_from_world[:3, :3]
    lengths = np.linalg.norm(directions, axis=-1)
    origin = np.broadcast_to(dataset.world.to_world(view.centre), directions.shape)
    # Where surfaces are depends on the rig's name alone, not on its light or its seed.
    scene = simulate(Session.open(dataset.session).record.origin.removeprefix("sim:")).scene
    return np.asarray(scene.depth(origin, directions / lengths[..., None]) / lengths)


def measured(depth: Array, noise: float, holes: float, rng: np.random.Generator) -> Array:
    """True depth [H, W] with noise, a share of itself, and holes of 0 over a share of the picture."""
    noisy = depth * (1 + noise * rng.standard_normal(depth.shape))
    blobs = cv2.GaussianBlur(rng.standard_normal(depth.shape), (0, 0), BLOB * depth.shape[1])
    return np.where((blobs < np.quantile(blobs, 1 - holes)) & np.isfinite(noisy) & (noisy > 0), noisy, 0.0)


def add_depths(session: Path, noise: float, holes: float, seed: int, unit: float = MILLIMETRE) -> None:
    """Write a 16-bit PNG of depth for each view of a calibrated simulated session, in a given unit of the
    world.

    The records of the first shots say that they are in millimetres.
    """
    dataset, shots = load(session), Session.open(session).shots()
    rng = np.random.Generator(np.random.PCG64([seed, 0xDE]))
    records = {shot.identity: shot for shot in shots}
    for view in dataset.views:
        codes = np.rint(measured(true_depth(dataset, view), noise, holes, rng) / unit).clip(0, 65534)
        file = f"depths/{view.id}_0.png"
        store.write_bytes(session / file, encode_png(codes.astype(np.uint16)))
        first = next(shot for shot in shots if shot.view == view.id and shot.kind == "scene")
        records[first.identity] = first.model_copy(
            update={
                "depth": file,
                "depth_sha256": store.sha256(session / file),
                "depth_unit": MILLIMETRE,
            }
        )
    lines = [shot.model_dump_json(exclude_none=True) for shot in records.values()]
    store.write_bytes(session / "shots.jsonl", "".join(f"{line}\n" for line in lines).encode())
