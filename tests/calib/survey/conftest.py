"""Points on the surfaces of the simulator's scene, as a surveyor and somebody who clicks would have them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.calibration.pose_error import true_poses
from calib.poses import sfm
from drivers.sim.camera.lens import project, unproject
from drivers.sim.rigs import simulate
from imaging.arrays import Array
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.session.calibration import read_calibration
from imaging.session.coordinates import PointMark
from imaging.session.view_id import ViewId


@dataclass(frozen=True, eq=False)
class Staked:
    """Points by name in the world of the truth, m, and where views truly show them, px of the files."""

    places: dict[str, Array]
    pixels: dict[str, dict[ViewId, Array]]

    def marks(self, error: float, seed: int = 0) -> dict[str, dict[ViewId, PointMark]]:
        """Clicked with a normal error, px."""
        rng = np.random.default_rng(seed)
        return {
            name: {
                view: PointMark(view=view, at=tuple((at + rng.normal(0, error, 2)).tolist()))
                for view, at in by_view.items()
            }
            for name, by_view in self.pixels.items()
        }


def stake(session: Path, count: int, seed: int = 0) -> Staked:
    """Points that at least four views see, each away from the others."""
    truth = store.read_json(session / "truth" / "truth.json")
    scene = simulate(truth["rig"], truth["seed"]).scene
    lenses = {name: Lens.model_validate(camera["lens"]) for name, camera in truth["cameras"].items()}
    poses = true_poses(session)
    rng = np.random.default_rng(seed)
    places: dict[str, Array] = {}
    pixels: dict[str, dict[ViewId, Array]] = {}
    while len(places) < count:
        view = list(poses)[rng.integers(len(poses))]
        ray = unproject(lenses[view.camera], rng.uniform((20, 20), (300, 220))[None])[0]
        motion = poses[view]
        direction = np.append(ray, 1.0)[:3] @ motion[:3, :3]
        direction /= np.linalg.norm(direction)
        centre = -motion[:3, :3].T @ motion[:3, 3]
        away = scene.depth(centre[None], direction[None])[0]
        if not np.isfinite(away):
            continue
        place = centre + away * direction
        if any(np.linalg.norm(place - other) < 0.15 for other in places.values()):
            continue
        visible = {
            other: at for other in poses if (at := _place_in(scene, lenses, poses, other, place)) is not None
        }
        if len(visible) >= 4:
            places[f"P{len(places)}"], pixels[f"P{len(pixels)}"] = place, visible
    return Staked(places, pixels)


def _place_in(
    scene: Any, lenses: dict[str, Lens], poses: dict[ViewId, Array], view: ViewId, place: Array
) -> Array | None:
    """Place in a view, px; None if hidden or outside."""
    motion, lens = poses[view], lenses[view.camera]
    local = motion[:3, :3] @ place + motion[:3, 3]
    if local[2] <= 0:
        return None
    at = np.asarray(project(lens, local[None])[0])
    if not ((at > 5).all() and (at < (lens.width - 5, lens.height - 5)).all()):
        return None
    centre = -motion[:3, :3].T @ motion[:3, 3]
    far = float(np.linalg.norm(place - centre))
    hit = scene.depth(centre[None], ((place - centre) / far)[None])[0]
    return at if abs(hit - far) < 2e-3 * far else None


def write_points(
    path: Path, places: dict[str, Array], heading: str = "name,x,y,z,sigma", sigma: str = "0.002"
) -> Path:
    rows = [",".join([name, *(f"{value:.9f}" for value in place), sigma]) for name, place in places.items()]
    path.write_text("\n".join([heading, *rows, ""]))
    return path


def write_marks(path: Path, marks: dict[str, dict[ViewId, PointMark]]) -> Path:
    rows = [
        f"{name},{view},{mark.at[0]:.4f},{mark.at[1]:.4f}"
        for name, by_view in marks.items()
        for view, mark in by_view.items()
    ]
    path.write_text("\n".join(["name,image,u,v", *rows, ""]))
    return path


@pytest.fixture(scope="session")
def staked(arm: Path) -> Staked:
    return stake(arm, 10)


@pytest.fixture
def model_of() -> Callable[[Path], sfm.SceneModel]:
    """The model of a session that was calibrated; its pictures have the size of its files."""

    def read(session: Path) -> sfm.SceneModel:
        reconstruction = pycolmap.Reconstruction(str(session / "calibration" / "colmap"))
        record = read_calibration(session)
        fields = sfm.fields_of(reconstruction)
        metric = record.unit == "m"
        return sfm.SceneModel(reconstruction, **fields, rungs=(), errors=None, metric=metric)

    return read
