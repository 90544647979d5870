"""Comparison of an open scene with the one in its folder, whose files show it only if they are equal."""

import torch
from torch import Tensor

from recon.result.model import CHECKPOINT, read_model
from recon.result.scene import Scene
from recon.scene.appearance import Parameters
from recon.scene.checkpoint import read_checkpoint
from recon.scene.environment import NAME as ENVIRONMENT
from recon.scene.gaussians import Gaussians

_SHOWN = ("exposure", "normaliser", "degree", "bands", "display", "world", "offset")
"""Fields of the record on which the Gaussians of splats.ply depend."""


def is_stored(scene: Scene) -> bool:
    """Return whether what is drawn of a scene is what its folder holds: Gaussians that no renderer draws may
    be left out, and nothing else may differ.
    """
    record = read_model(scene.folder)
    if any(getattr(record, name) != getattr(scene.record, name) for name in _SHOWN):
        return False
    checkpoint = read_checkpoint(scene.folder / CHECKPOINT)
    far = scene.renderer.environment
    if not _same({} if far is None else far.tensors(), checkpoint.part(ENVIRONMENT)):
        return False
    ours, theirs = scene.gaussians, Gaussians(checkpoint.part("gaussians"))
    return _same(ours.rows(drawable(ours)), theirs.rows(drawable(theirs)))


def drawable(gaussians: Gaussians) -> Tensor:
    """Mask of Gaussians that renderers draw, bool [N]: finite, with a rotation and an opacity above 0."""
    parameters = gaussians.parameters
    finite = torch.ones(len(gaussians), dtype=torch.bool)
    for name, value in parameters.items():
        if name != "opacity_logits":
            finite &= torch.isfinite(value.detach()).flatten(1).all(1) if value.ndim > 1 else value.isfinite()
    finite &= torch.isfinite(gaussians.scales()).all(1) & (gaussians.scales() > 0).all(1)
    finite &= gaussians.opacities() > 0  # of NaN neither
    return finite & (parameters["quats"].abs().amax(1) > 0)


def _same(ours: Parameters, theirs: Parameters) -> bool:
    return ours.keys() == theirs.keys() and all(torch.equal(ours[name], theirs[name]) for name in ours)
