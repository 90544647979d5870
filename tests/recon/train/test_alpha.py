"""Photographs with alpha: a scene is opaque where they are, and nothing is where they are transparent."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from drivers.sim.scene.tabletop import demo_scene
from recon.data.dataset import Dataset, View
from recon.data.geometry import rays
from recon.data.load import load
from recon.train.densification import DensityRules
from recon.train.trainer import train
from recon.train.training import Plan
from tests.recon.beginning import beginning

NEAR = 1.0
"""In scene coordinates, along the axis of a view: what lies behind is cut out of the photographs."""


def depth(dataset: Dataset, view: View) -> np.ndarray:
    """True depth of every pixel, in scene coordinates [H, W]."""
    height, width = view.lens.height, view.lens.width
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)
    directions = rays(view.lens, pixels) @ view.lens.cam_from_world[:3, :3]
    origin = np.broadcast_to(dataset.world.to_world(view.centre), directions.shape)
    lengths = np.linalg.norm(directions, axis=-1)
    return demo_scene().depth(origin, directions) / (lengths * dataset.world.unit)


def cut_out(dataset: Dataset, view: View, with_alpha: bool) -> View:
    """A view of what stands on the table's near part: before black, and with alpha if it is told."""
    height, width = view.lens.height, view.lens.width
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)
    place = rays(view.lens, pixels) * depth(dataset, view)[..., None]
    motion = view.lens.cam_from_world
    place = (place - motion[:3, 3]) @ motion[:3, :3]
    cover = (np.linalg.norm(place - dataset.points().xyz.mean(0), axis=-1) < NEAR / 2).astype(np.float32)
    shots = tuple(
        shot.showing(
            pixels=(shot.pixels * cover[..., None]).astype(np.float32), alpha=cover if with_alpha else None
        )
        for shot in view.shots
    )
    return replace(view, shots=shots)


def errors_of_alpha(dataset: Dataset, with_alpha: bool) -> float:
    """Mean absolute error of the rendered alpha, over the training views, of a short training."""
    goal = [cut_out(dataset, view, True).alpha for view in dataset.train]
    part = replace(dataset, train=tuple(cut_out(dataset, view, with_alpha) for view in dataset.train))
    training = beginning(part, 600)("hdr-gs")
    train(training, part, Plan(80, DensityRules(800)))
    off = []
    for view, cover in zip(part.train, goal, strict=True):
        with torch.no_grad():
            alpha = training.renderer()(training.gaussians, view.lens, degree=0).alpha
        assert cover is not None
        assert 0.1 < cover.mean() < 0.9
        off.append(float(np.abs(alpha.numpy() - cover).mean()))
    return float(np.mean(off))


def test_alpha_of_photographs_is_learned(toy_ldr: Path) -> None:
    dataset = load(toy_ldr)
    given, guessed = (errors_of_alpha(dataset, given) for given in (True, False))
    assert given < 0.1
    assert given < guessed / 2
