"""Surfaces that the Gaussians of a scene lie on: what views saw of them, and which way they face."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from imaging.arrays import Array, Integers, Mask
from imaging.progress import Progress, unreported
from recon.data.geometry import inside, project
from recon.result.scene import Scene
from recon.result.trust import WIDTH, measured, visible
from recon.scene.environment import Environment
from recon.splat import SplatCamera

SOLID = 0.3
"""Opacity from which on a Gaussian says where a surface is."""
NEIGHBOURS = 16
"""Gaussians that a plane is laid through."""
_ROUNDS = 3
"""Times that a plane is laid anew, with less weight for what is away from it: the other side of an edge."""
_FAR = 1e6


@dataclass(frozen=True, eq=False)
class Observations:
    """Observations of N Gaussians by the training views, in scene units and axes.

    views [N]: their number. light [N, C]: mean radiance towards them. spread [N]: standard deviation of its
    logarithm over them. towards [N, 3]: mean direction to them. sky: of the texels of the environment,
    [rows, 2 * rows], whether a view saw and measured it; None without one.
    """

    views: Array
    light: Array
    spread: Array
    towards: Array
    sky: Mask | None


def observations_of(scene: Scene, progress: Progress = unreported) -> Observations:
    """Collect what the training views saw, by what reaches their pictures and what their shots measure."""
    gaussians, renderer = scene.gaussians, scene.renderer
    means = gaussians.parameters["means"].detach().double().numpy()
    views, squares, logs = (np.zeros(len(means)) for _ in range(3))
    light, towards = np.zeros((len(means), len(scene.channels))), np.zeros((len(means), 3))
    sky = None if renderer.environment is None else np.zeros(renderer.environment.ln_light.shape[1:], bool)
    training = [view for view in scene.views if view.use == "training"]
    for done, view in enumerate(training):
        progress("reading what the views saw", done, len(training))
        camera = scene.record.world.camera(view.splat_camera)
        if camera.width > WIDTH:
            camera = camera.resized(WIDTH)
        with torch.no_grad():
            colours = renderer.colours(gaussians, camera, scene.record.degree).double().numpy()
        there = (visible(scene, camera) & measured(scene, view, camera)).numpy()
        log = np.log(np.maximum(colours.mean(1), 1e-12))
        away = camera.world_from_cam[:3, 3] - means
        views += there
        light += colours * there[:, None]
        logs += log * there
        squares += log**2 * there
        towards += away / np.linalg.norm(away, axis=1, keepdims=True).clip(1e-12) * there[:, None]
        if sky is not None and renderer.environment is not None:
            sky |= _sky_in_picture(scene, renderer.environment, camera) & _sky_measured(scene, view.shots)
    count = np.maximum(views, 1)
    spread = np.sqrt(np.maximum(squares / count - (logs / count) ** 2, 0))
    length = np.linalg.norm(towards, axis=1, keepdims=True).clip(1e-12)
    return Observations(views, light / count[:, None], spread, towards / length, sky)


def _sky_in_picture(scene: Scene, far: Environment, camera: SplatCamera) -> Mask:
    """Texels whose light reaches a picture for the most part."""
    directions = far.directions()
    pixels, depth = project(camera, camera.world_from_cam[:3, 3] + _FAR * directions)
    here = inside(camera, pixels, depth)
    # Behind a wide lens points fold over: they are in the picture where their ray leads back to them.
    free = scene.covered(camera).numpy() < 0.5
    column, row = np.moveaxis(pixels[here].astype(np.intp), -1, 0)
    reached = np.zeros(directions.shape[:-1], bool)
    reached[here] = free[row, column]
    return reached


def _sky_measured(scene: Scene, shots: "tuple[object, ...]") -> Mask:
    far = scene.renderer.environment
    assert far is not None
    light = scene.in_units(far.ln_light.detach().exp().movedim(0, 2))
    result = np.zeros(light.shape[:2], bool)
    for shot in shots:
        least, most = getattr(shot, "measures", None) or (-np.inf, np.inf)
        result |= ((light > least) & (light < most)).any(-1)
    return result


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes through the neighbours of N points.

    points [N, 3] on them; unit normals [N, 3] towards the views; thickness [N], by which neighbours are off
    them (a standard deviation); tilt [N]: their error, radians.
    """

    points: Array
    normals: Array
    thickness: Array
    tilt: Array


def planes_at(means: Array, weights: Array, towards: Array) -> Planes:
    """Lay planes through the nearest of points [N, 3] with a weight [N], each facing `towards` [N, 3]."""
    solid = np.flatnonzero(weights > 0)
    count = min(NEIGHBOURS, len(solid))
    distance, rows = cKDTree(means[solid]).query(means, count)
    near: Integers = solid[rows.reshape(len(means), count)]
    distance = distance.reshape(len(means), count)
    reach = np.maximum(np.median(distance, axis=1, keepdims=True), 1e-12)
    base = weights[near] * np.exp(-0.5 * (distance / (1.5 * reach)) ** 2)
    weight = base
    for _ in range(_ROUNDS):
        total = weight.sum(1)[:, None]
        middle = np.einsum("nk,nki->ni", weight, means[near]) / total
        apart = means[near] - middle[:, None]
        spread = np.einsum("nk,nki,nkj->nij", weight, apart, apart) / total[..., None]
        values, vectors = np.linalg.eigh(spread)
        normal = vectors[..., 0]
        off = np.einsum("nki,ni->nk", apart, normal)
        deviation = 1.48 * np.median(np.abs(off), axis=1, keepdims=True)
        scale = np.maximum(deviation, 0.02 * reach)
        weight = base / (1 + (off / scale) ** 2) ** 2
    facing = np.sign(np.einsum("ni,ni->n", normal, towards))
    normal = normal * np.where(facing == 0, 1, facing)[:, None]
    along = np.einsum("ni,ni->n", means - middle, normal)
    values = np.maximum(values, 0)
    tilt = np.arctan2(np.sqrt(values[:, 0]), np.sqrt(np.maximum(values[:, 1], 1e-24)))
    return Planes(means - along[:, None] * normal, normal, deviation[:, 0], tilt)
