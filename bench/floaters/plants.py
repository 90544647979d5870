"""Trainings with floaters in them, and how much of them is seen."""

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation, Slerp
from torch import Tensor

from drivers.sim.rigs import simulate
from drivers.sim.scene.solids import distance
from imaging.compute.jit import compiled
from imaging.session.session import Session
from recon.data.dataset import Dataset
from recon.data.light import light_of, radiance_image
from recon.decide.steps.method_choice import method_for
from recon.methods import METHODS
from recon.scene.gaussians import Gaussians
from recon.splat import SplatCamera, rasterize
from recon.start.initialisation import gaussians_at, start_points
from recon.train.densification import Change, DensityRules
from recon.train.schedule import rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training

SHARE = 0.02
"""Share of the Gaussians that are planted."""
CLEAR = 0.04
"""Distance from every surface, relative to the scene's depth, beyond which a Gaussian is in the air."""


def begun(dataset: Dataset, gaussians: int, iterations: int, seed: int) -> tuple[Training, Plan]:
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    points = start_points(dataset, images, gaussians // 2, np.random.Generator(np.random.PCG64(seed)))
    method = METHODS[method_for(dataset, "auto")[0]](dataset, light)
    start = gaussians_at(points, method.appearance, method.observation.units)
    training = Training.begin(method, light, start, dataset.extent)
    plan = Plan(
        iterations, DensityRules(gaussians), seed, log_every=iterations, rate_factor=rate_factor(iterations)
    )
    return training, plan


def on(training: Training, dataset: Dataset, plan: Plan, until: float) -> None:
    at = round(until * plan.iterations)
    train(training, dataset, plan, until=at)


def copied(training: Training) -> Training:
    """Another that goes on as this one would; what views share, once prepared, stays shared."""
    return copy.deepcopy(training, {id(training.method): training.method})


def weights(gaussians: Gaussians, which: Tensor, cameras: list[SplatCamera], training: Training) -> float:
    """Mean over pixels and cameras of the blending weight of some of the Gaussians."""
    colours = which.float()[:, None]
    limits = training.renderer().limits
    total = 0.0
    with torch.no_grad():
        for camera in cameras:
            part = gaussians.parameters
            image = rasterize(
                part["means"], part["quats"], gaussians.scales(), gaussians.opacities(), colours, camera,
                None, replace(limits, luminance_reference=None),
            ).image  # fmt: skip
            total += float(image.mean())
    return total / len(cameras)


def between(dataset: Dataset) -> list[SplatCamera]:
    """The cameras of held-out views, and those midway between each training view and its nearest one."""
    cameras = [view.lens for view in dataset.held_out]
    for number, view in enumerate(dataset.train):
        away = [
            float(np.linalg.norm(view.centre - other.centre)) if place != number else np.inf
            for place, other in enumerate(dataset.train)
        ]
        other = dataset.train[int(np.argmin(away))]
        ends = np.stack([view.lens.cam_from_world[:3, :3], other.lens.cam_from_world[:3, :3]])
        turn = Slerp([0, 1], Rotation.from_matrix(ends))(0.5).as_matrix()
        motion = np.eye(4)
        motion[:3, :3] = turn
        motion[:3, 3] = -turn @ ((view.centre + other.centre) / 2)
        cameras.append(replace(view.lens, cam_from_world=motion))
    return cameras


def depths(training: Training, camera: SplatCamera) -> np.ndarray:
    """Expected camera z of what a camera sees, [H, W]."""
    part, gaussians = training.gaussians.parameters, training.gaussians
    motion = torch.from_numpy(camera.cam_from_world).float()
    with torch.no_grad():
        z = part["means"] @ motion[2, :3] + motion[2, 3]
        render = rasterize(
            part["means"], part["quats"], gaussians.scales(), gaussians.opacities(), z[:, None], camera
        )
    return (render.image[..., 0] / render.alpha.clamp_min(1e-3)).numpy()


def plant(training: Training, dataset: Dataset, seed: int) -> Tensor:
    """Add floaters behind the others; bool [N], which they are."""
    rng = np.random.Generator(np.random.PCG64([seed, 0xF10A7]))
    count = round(SHARE * len(training.gaussians))
    depth_maps = [depths(training, view.lens) for view in dataset.train]
    centres: list[np.ndarray] = []
    sizes: list[np.ndarray] = []
    while len(centres) < count:
        number = int(rng.integers(len(depth_maps)))
        lens, depth = dataset.train[number].lens, depth_maps[number]
        row, column = (int(rng.integers(side)) for side in depth.shape)
        z = float(depth[row, column]) * rng.uniform(0.1, 0.7)
        if z > 0.02:
            ray = np.array([(column + 0.5 - lens.cx) / lens.fx, (row + 0.5 - lens.cy) / lens.fy, 1.0]) * z
            motion = lens.cam_from_world
            centres.append(motion[:3, :3].T @ (ray - motion[:3, 3]))
            sizes.append(z * rng.uniform(0.01, 0.05, 3))
    like = torch.from_numpy(rng.integers(0, len(training.gaussians), count))
    new = training.gaussians.rows(like)
    new["means"] = torch.from_numpy(np.array(centres)).float()
    new["log_scales"] = torch.from_numpy(np.log(sizes)).float()
    opacity = np.where(np.arange(count) % 2, rng.uniform(0.5, 0.95, count), rng.uniform(0.05, 0.2, count))
    new["opacity_logits"] = torch.logit(torch.from_numpy(opacity)).float()
    keep = torch.ones(len(training.gaussians), dtype=torch.bool)
    Change(keep, new).apply(training.gaussians, training.optimizer)
    training.count_anew()
    return torch.cat([torch.zeros(len(keep), dtype=torch.bool), torch.ones(count, dtype=torch.bool)])


def in_the_air(session: Path, training: Training, dataset: Dataset) -> Tensor | None:
    """Return which Gaussians are farther than `CLEAR` from every surface; None if the truth is unknown."""
    origin = Session.open(session).record.origin
    if not origin.startswith("sim:"):
        return None
    solids = simulate(origin.removeprefix("sim:")).scene.solids
    places = dataset.world.to_world(training.gaussians.parameters["means"].detach().numpy())
    return torch.from_numpy(_off(solids, places) > CLEAR * dataset.world.unit)


@compiled
def _off(solids: Any, places: Any) -> Any:
    """Distance of places [N, 3] from the nearest surface, m, [N]."""
    off = np.full(len(places), np.inf)
    for row in range(len(places)):
        for number in range(len(solids)):
            away = distance(solids[number], places[row, 0], places[row, 1], places[row, 2])
            off[row] = min(off[row], abs(away))
    return off
