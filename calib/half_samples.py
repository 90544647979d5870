"""How sure poses and lenses from a scene are: adjusted again to random halves of its points.

An estimate from half of the points lies from that of all as far, in the mean square, as that of all lies
from the truth (the delete-half jackknife: Shao and Wu, "A General Theory for Jackknife Variance Estimation",
1989), as far as points err independently. The middle of the image and a second radial term are free
meanwhile, whatever the ladder took: that a term is too small to be seen makes what it trades places with no
surer.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from calib.adjust import Free, adjust, opencv_parameters
from calib.features import Key, key_of
from calib.views import Progress
from imaging.colmap import pycolmap

Array = npt.NDArray[np.float64]

DRAWS = 16
FEWEST_POINTS = 60
TERMS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")


@dataclass(frozen=True)
class Spread:
    """Standard errors.

    rotation: degrees, and translation: in units of the model, of each view, about and along its worst axis;
    lenses: by camera and term, in the pixels of the model.
    """

    rotation: dict[Key, float]
    translation: dict[Key, float]
    lenses: dict[str, dict[str, float]]


def measure(reconstruction: Any, free: Free, scale: float, threads: int, progress: Progress) -> Spread | None:
    """Adjust to halves, DRAWS times; None when there are too few points to halve them. Changes nothing.

    free: how the model was adjusted; what is fixed in it stays fixed. scale: the typical miss of the model's
    points, px.
    """
    richest = replace(free, model="RADIAL", principal_point=True)
    points = sorted(reconstruction.points3D)
    if len(points) < FEWEST_POINTS:
        return None
    rng = np.random.default_rng(0)
    every = pycolmap.Reconstruction(reconstruction)
    adjust(every, richest, scale, threads)
    whole = _poses(every)
    turns: dict[Key, list[Array]] = {key: [] for key in whole}
    shifts: dict[Key, list[Array]] = {key: [] for key in whole}
    terms: dict[str, list[Array]] = {}
    for draw in range(DRAWS):
        progress("measuring how sure it is", draw, DRAWS)
        half = pycolmap.Reconstruction(every)
        for point in rng.permutation(points)[: len(points) // 2].tolist():
            half.delete_point3D(point)
        adjust(half, richest, scale, threads)
        found = _aligned(_poses(half), whole)
        for key, pose in found.items():
            apart = pose @ np.linalg.inv(whole[key])
            turns[key].append(_turned(apart[:3, :3]))
            shifts[key].append(_centre(pose) - _centre(whole[key]))
        for index in half.reg_image_ids():
            image = half.image(index)
            name = key_of(image.name)[0]
            if len(terms.setdefault(name, [])) <= draw:
                own = np.array(opencv_parameters(half.cameras[image.camera_id]))
                terms[name].append(own - opencv_parameters(every.cameras[image.camera_id]))
    progress("measuring how sure it is", DRAWS, DRAWS)
    return Spread(
        rotation={key: float(np.degrees(_widest(own))) for key, own in turns.items()},
        translation={key: _widest(own) for key, own in shifts.items()},
        lenses={
            name: dict(zip(TERMS, np.sqrt(np.mean(np.stack(own) ** 2, axis=0)).tolist(), strict=True))
            for name, own in terms.items()
        },
    )


def _poses(reconstruction: Any) -> dict[Key, Array]:
    """cam_from_world [4, 4] of every registered view."""
    poses = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        poses[key_of(image.name)] = np.vstack([image.cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]])
    return poses


def _aligned(poses: Mapping[Key, Array], to: Mapping[Key, Array]) -> dict[Key, Array]:
    """The poses in the world of others: by all turns first, since centres may lie in a plane or a line."""
    keys = sorted(poses)
    relative = sum((to[key][:3, :3].T @ poses[key][:3, :3] for key in keys), np.zeros((3, 3)))
    u, _, vt = np.linalg.svd(relative)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt  # new world from old
    old = np.stack([turn @ _centre(poses[key]) for key in keys])
    new = np.stack([_centre(to[key]) for key in keys])
    spread = old - old.mean(0)
    size = float((spread**2).sum())
    scale = float((spread * (new - new.mean(0))).sum()) / size if size > 0 else 1.0
    aligned = {}
    for key, place in zip(keys, old, strict=True):
        pose = np.eye(4)
        pose[:3, :3] = poses[key][:3, :3] @ turn.T
        pose[:3, 3] = -pose[:3, :3] @ (scale * (place - old.mean(0)) + new.mean(0))
        aligned[key] = pose
    return aligned


def _centre(pose: Array) -> Array:
    return np.asarray(-pose[:3, :3].T @ pose[:3, 3])


def _turned(rotation: Array) -> Array:
    """Small rotation as axis times angle, rad."""
    skew = (rotation - rotation.T) / 2
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def _widest(vectors: list[Array]) -> float:
    """Root mean square along the direction in which it is the largest."""
    stack = np.stack(vectors)
    return float(np.sqrt(np.linalg.eigvalsh(stack.T @ stack / len(stack))[-1].clip(0.0)))
