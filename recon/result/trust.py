"""Number of photographs behind each part of a scene.

A view counts for a Gaussian if it saw it and measured its light. It saw it if the light reaches its picture:
what the Gaussian adds to the picture is at least `SHARE` of what it would add alone, or that holds at its
best pixel, for one that reaches beyond the picture. It measured it if in one of its shots a channel of the
light is above the noise and below white (`SceneShot.measures`); a bracket counts once, as it looks from one
place. Nothing of this reads a photograph: it is in model.json.
"""

import math
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from imaging.progress import Progress, unreported
from recon.result.model import SceneView
from recon.scene.gaussians import drawn_values
from recon.scene.sampling import away_from, footprint
from recon.splat import SplatCamera, SplatStats
from recon.splat.torch_threads import torch_on_one_thread

if TYPE_CHECKING:
    from recon.result.scene import Scene

SHARE = 0.15
"""Share of its light that has to reach the picture. Surfaces are made of several layers, of which the rear
ones are not hidden: behind an opaque surface a hundredth gets through.
"""
WIDTH = 480
"""Pixels across at which views are drawn for this, at most."""


def photographs_that_saw(scene: "Scene", progress: Progress = unreported) -> Tensor:
    """Count the training views in which each Gaussian was seen and measured, float32 [N]."""
    views = [view for view in scene.views if view.use == "training"]
    counts = torch.zeros(len(scene.gaussians))
    for done, view in enumerate(views):
        progress("counting photographs", done, len(views))
        camera = scene.record.world.camera(view.splat_camera)
        if camera.width > WIDTH:
            camera = camera.resized(WIDTH)
        with torch_on_one_thread():
            counts += (visible(scene, camera) & measured(scene, view, camera)).float()
    progress("counting photographs", len(views), len(views))
    return counts


def visible(scene: "Scene", camera: SplatCamera) -> Tensor:
    """Mask of the Gaussians that a camera in scene coordinates sees, bool [N]: not those outside and those
    hidden.
    """
    with torch.no_grad():
        means, quats, scales, opacities = shapes = scene.renderer.shapes(scene.gaussians, camera)
    stats = SplatStats(len(means))
    with torch.enable_grad():
        values = torch.zeros(len(means), 1, requires_grad=True)
        render = drawn_values(shapes, values, camera, scene.renderer.limits, stats)
        (added,) = torch.autograd.grad(render.image.sum(), values)
    with torch.no_grad():
        limits = scene.renderer.limits
        area = footprint(away_from(means, camera), scales, quats, camera, limits.blur)
        alone = area * (opacities - limits.alpha_min).clamp_min(0)
        return (added[:, 0] > SHARE * alone.clamp_min(1e-12)) | (stats.weight > SHARE * opacities)


def measured(scene: "Scene", view: SceneView, camera: SplatCamera) -> Tensor:
    """Mask of the Gaussians whose light a shot of a view measures, bool [N]; camera: of the view, in the
    scene.
    """
    parameters = scene.gaussians.parameters
    with torch.no_grad():
        away = away_from(parameters["means"], camera)
        directions = torch.nn.functional.normalize(away, dim=1)
        colours = scene.renderer.appearance.colours(parameters, directions, scene.record.degree)
        light = torch.from_numpy(scene.in_units(colours[None])[0])
    result = torch.zeros(len(light), dtype=torch.bool)
    for shot in view.shots:
        least, most = shot.measures or (-math.inf, math.inf)
        result |= ((light > least) & (light < most)).any(1)
    return result
