"""Splats that somebody else made, opened as a scene: PLY in the layout of 3DGS, SPZ, and USD.

What was trained, by what and on which photographs, such files do not say. Cameras are those of the file, or
an orbit around the Gaussians. Colours are display values, sRGB, unless the file says that they are linear
light. Display values are drawn as 3DGS draws, with its blur and its cut-offs, light as `rig` draws; where the
file says that its Gaussians were trained with the filters of Mip-Splatting, they are drawn with them.
"""

import itertools
import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from imaging.arrays import Array, Mask
from imaging.errors import InputError
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.calibration import Response
from recon.data.world import Vector, WorldTransform
from recon.decide.settings import Settings
from recon.result.model import DisplayValues, ModelRecord, SceneView
from recon.scene.appearance import PlainHarmonics
from recon.scene.gaussians import Gaussians, Renderer, limits_for
from recon.scene.harmonics import COEFFICIENTS, DEGREE
from recon.scene.ply_file import PlySplats, read_ply, stated_offset
from recon.scene.sampling import Sampling
from recon.scene.spz import read_spz
from recon.scene.usd_field import UsdCamera, read_usd
from recon.splat import Limits

ORBIT = 12
"""Views around a file without cameras."""
_LOOK_DOWN = np.radians(15.0)
_LENS = Lens(model="PINHOLE", width=640, height=480, fx=600.0, fy=600.0, cx=320.0, cy=240.0)
_SPAN = 2.0**-20
"""The dimmest light that matters, of the brightest."""
_AWAY = 3.0
"""Distance of an orbit, in radii around the middle that hold half of the Gaussians: skies are far away."""


def read_splats(path: Path) -> tuple[ModelRecord, Gaussians, Renderer, Vector]:
    """Read a scene from a file of splats: its record, its Gaussians and their renderer, and the offset that
    the file states (`Scene.stated`).

    Gaussians with values that are not finite are left out. InputError for another kind of file, a damaged
    one, or holds no Gaussian that can be drawn.
    """
    cameras: tuple[UsdCamera, ...] = ()
    offset: Vector = (0.0, 0.0, 0.0)
    up = np.array([0.0, -1.0, 0.0])  # y points down, as in most files of 3DGS
    suffix = path.suffix.lower()
    if suffix == ".ply":
        file = read_ply(path)
        stated = any(re.match(r"linear Rec\.709 radiance|false colours", line) for line in file.comments)
        linear = file.linear or stated
        offset = stated_offset("\n".join(file.comments)) or offset
        if "Vertical Axis: z" in file.comments:  # nerfstudio's
            up = np.array([0.0, 0.0, 1.0])
    elif suffix == ".spz":
        file, linear = read_spz(path), False
    else:
        field = read_usd(path)
        file, linear, up, cameras = field.splats, field.linear, field.up, field.cameras
        offset = field.offset
    values = np.column_stack([file.means, file.log_scales, file.quats, file.harmonics.reshape(len(file), -1)])
    valid = np.isfinite(values).all(1) & ~np.isnan(file.logits) & (np.abs(file.quats).max(1, initial=0) > 0)
    if not valid.any():
        raise InputError(f"{path} holds no Gaussian that can be drawn: export it again.")
    means = file.means[valid]
    middle = np.median(means, axis=0)
    reach = float(np.median(np.linalg.norm(means - middle, axis=1)))
    world = WorldTransform(origin=tuple(middle.tolist()), unit=_AWAY * reach if reach > 0 else 1.0)
    views = _views_of(cameras) or _orbit(middle, world.unit, up)
    gaussians = _gaussians(file, valid, world)
    degree = min(int(np.sqrt(file.harmonics.shape[1])) - 1, DEGREE)
    brightest = float(PlainHarmonics().luminance(gaussians.parameters).max())
    reference = _SPAN * brightest if linear and brightest > 0 else None
    record = _record(path, world, views, len(gaussians), degree, linear, reference)
    limits = limits_for(reference) if linear else Limits.gsplat()
    if file.made_up is None:
        return record, gaussians, Renderer(PlainHarmonics(), limits), offset
    # All of the blur is made up for, as if they had been trained on an infinitely fine picture.
    finest = Sampling(torch.zeros(len(gaussians)), torch.zeros(len(gaussians)))
    renderer = Renderer(PlainHarmonics(), replace(limits, blur=file.made_up), sampling=finest)
    return record, gaussians, renderer, offset


def _gaussians(file: PlySplats, valid: Mask, world: WorldTransform) -> Gaussians:
    harmonics = file.harmonics[valid]
    rest = np.zeros((len(harmonics), COEFFICIENTS - 1, 3))
    shown = harmonics[:, 1:COEFFICIENTS]
    rest[:, : shown.shape[1]] = shown
    values = {
        "means": world.from_world(file.means[valid]),
        "log_scales": file.log_scales[valid] - np.log(world.unit),
        "quats": file.quats[valid],
        "opacity_logits": file.logits[valid].clip(-80, 80),
        "sh_dc": harmonics[:, :1],
        "sh_rest": rest,
    }
    return Gaussians({name: torch.from_numpy(value.astype(np.float32)) for name, value in values.items()})


def _views_of(cameras: Sequence[UsdCamera]) -> tuple[SceneView, ...]:
    """The views of cameras, under names of their own: two prims of one name would be one camera."""
    names: dict[str, str] = {}
    for camera in cameras:
        if camera.prim not in names:
            plain = re.sub(r"\.\.+", ".", re.sub(r"[^A-Za-z0-9_.-]", "_", camera.name))
            plain = re.sub(r"^[^A-Za-z0-9]+", "", plain) or "camera"
            numbered = (f"{plain}-{number}" for number in itertools.count(2))
            candidates = itertools.chain([plain], numbered)
            names[camera.prim] = next(name for name in candidates if name not in names.values())
    return tuple(_view_of(camera, names[camera.prim]) for camera in cameras)


def _view_of(camera: UsdCamera, name: str) -> SceneView:
    return SceneView(
        camera=name,
        frame=camera.frame,
        use="training",
        lens=camera.lens,
        cam_from_world=_pose(camera.cam_from_field),
        shots=(),
    )


def _orbit(middle: Array, away: float, up: Array) -> tuple[SceneView, ...]:
    """Cameras in a circle that look at the middle from a little above."""
    ahead = np.eye(3)[np.argmin(np.abs(up))]
    ahead = ahead - (ahead @ up) * up
    ahead /= np.linalg.norm(ahead)
    views = []
    for frame in range(ORBIT):
        turn = Rotation.from_rotvec(2 * np.pi * frame / ORBIT * up)
        level = turn.apply(ahead)
        out = np.cos(_LOOK_DOWN) * level + np.sin(_LOOK_DOWN) * up
        right = np.cross(-out, up)
        right /= np.linalg.norm(right)
        motion = np.eye(4)
        motion[:3, :3] = right, np.cross(-out, right), -out
        motion[:3, 3] = -motion[:3, :3] @ (middle + away * out)
        views.append(_view_of(UsdCamera("", "orbit", frame, _LENS, motion), "orbit"))
    return tuple(views)


def _pose(motion: Array) -> Pose:
    w, x, y, z = Rotation.from_matrix(motion[:3, :3]).as_quat(canonical=True, scalar_first=True).tolist()
    a, b, c = motion[:3, 3].tolist()
    return Pose(quaternion=(w, x, y, z), translation=(a, b, c))


def _record(
    path: Path,
    world: WorldTransform,
    views: tuple[SceneView, ...],
    count: int,
    degree: int,
    linear: bool,
    reference: float | None,
) -> ModelRecord:
    display = None
    if not linear:
        assumed = Response(kind="srgb", evidence="assumed: the file does not say what its colours are")
        display = DisplayValues(response=assumed, k=1.0)
    return ModelRecord(
        created=datetime.fromtimestamp(path.stat().st_mtime, UTC),
        versions={},
        settings=Settings(
            method="vanilla",
            quality="draft",
            seed=0,
            iterations=0,
            max_gaussians=count,
            max_width=_LENS.width,
        ),
        session=path.name,
        photographs_sha256="",
        calibration_sha256="",
        normaliser=1.0,
        reference=reference,
        display=display,
        radiance=f"relative to the colours of {path.name}",
        world=world,
        offset=(0.0, 0.0, 0.0),
        exposure=1.0,
        display_db=None,
        degree=degree,
        bands=(),
        views=views,
        gaussians=count,
        train_seconds=0.0,
        device="",
        loss=None,
        rungs=(),
        iterations=0,
        schedule=(),
        ending="schedule",
        held_out_db=None,
        measuring_seconds=0.0,
        predicted=None,
    )
