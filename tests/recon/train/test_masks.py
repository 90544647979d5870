"""Masks: what is painted over and masked leaves no trace; a mask that does not fit is told in a sentence."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from imaging import metrics
from imaging.errors import InputError
from imaging.files import store
from imaging.merge.masks import read_mask
from recon.data.light import light_of, radiance_image
from recon.data.load import load
from recon.data.truth import true_radiance
from recon.methods import METHODS
from recon.start.initialisation import colours_at, gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.trainer import train
from recon.train.training import Plan, Training

RECTANGLE = (18, 14)
"""Width and height, px, of what is painted over."""


def painted(dataset, *, masked, seed=4):
    """Something bright stands elsewhere in every training view, in all of its shots."""
    rng, views = np.random.default_rng(seed), []
    for view in dataset.train:
        left, top = (2 * rng.integers(0, (side - 20) // 2) for side in (view.lens.width, view.lens.height))
        hidden = np.zeros(view.shots[0].pixels.shape, bool)
        hidden[top : top + RECTANGLE[1], left : left + RECTANGLE[0]] = True
        shots = []
        for shot in view.shots:
            pixels = np.where(hidden, rng.uniform(0.4, 0.8, hidden.shape), shot.pixels).astype(np.float32)
            valid = shot.valid & ~hidden if masked else shot.valid
            saturated = shot.saturated & ~hidden
            shots.append(shot.showing(pixels=pixels, valid=valid, saturated=saturated))
        views.append(replace(view, shots=tuple(shots)))
    return replace(dataset, train=tuple(views))


def quality(dataset, name) -> float:
    """mu-law PSNR of the held-out view after a short training, dB."""
    images = [radiance_image(view) for view in dataset.train]
    light = light_of(dataset, images)
    points = start_points(dataset, images, 600, np.random.Generator(np.random.PCG64(0)))
    method = METHODS[name](dataset, light)
    gaussians = gaussians_at(points, method.appearance, method.observation.units)
    training = Training.begin(method, light, gaussians, dataset.extent)
    train(training, dataset, Plan(60, DensityRules(900)), log=lambda _: None, save=lambda: None)
    (view,) = dataset.held_out
    with torch.no_grad():
        image = training.renderer()(training.gaussians, view.lens, degree=2).image
    light = method.observation.radiance(image).numpy()
    truth = true_radiance(dataset.session, view)
    return metrics.hdr_psnr_mu(light * metrics.align_scale(light, truth), truth)


@pytest.mark.parametrize(
    ("which", "name", "cost", "harm", "paintings"),
    [("toy", "nh-3dgs", 0.8, 2.0, 3), ("toy_ldr", "hdr-gs", 0.8, 0.2, 8)],
)
def test_what_is_masked_leaves_no_trace(which, name, cost, harm, paintings, request):
    """A twelfth of every training view hidden costs little, not hidden more: means over paintings.

    Trainings of photographs scatter by 0.35 dB from one painting to the next, hence the more of them.
    """
    dataset = load(request.getfixturevalue(which))
    clean = quality(dataset, name)
    masked, spoilt = (
        np.mean(
            [quality(painted(dataset, masked=hidden, seed=seed), name) for seed in range(4, 4 + paintings)]
        )
        for hidden in (True, False)
    )
    assert masked > clean - cost
    assert spoilt < masked - harm


def test_no_colour_comes_from_behind_a_mask(toy_dataset):
    dataset = painted(toy_dataset, masked=True)
    images = [radiance_image(view) for view in dataset.train]
    spoilt = [
        (np.where(v.seen[..., None], rgb, 1e6), ok)
        for v, (rgb, ok) in zip(dataset.train, images, strict=True)
    ]
    points = start_points(toy_dataset, images, 300, np.random.Generator(np.random.PCG64(0))).xyz
    one, seen = colours_at(dataset, images, points)
    other, _ = colours_at(dataset, spoilt, points)
    assert seen.sum() > 100
    np.testing.assert_array_equal(one, other)


def masked_session(session, image):
    """A session whose first shot has the mask."""
    lines = [json.loads(line) for line in (session / "shots.jsonl").read_text().splitlines()]
    lines[0]["mask"] = "masks/first.png"
    (session / "shots.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    if image is not None:
        store.write_bytes(session / "masks" / "first.png", cv2.imencode(".png", image)[1].tobytes())
    return lines[0]["file"]


@pytest.mark.parametrize("width", [None, 32])
def test_the_mask_of_a_shot_is_read_and_scaled_with_it(session_copy, width):
    image = np.full((48, 64), 255, np.uint8)
    image[10:20, 8:24] = 0
    file = masked_session(session_copy, image)
    views = load(session_copy, max_width=width).views
    (shot,) = [shot for view in views for shot in view.shots if shot.file == file]
    kept = shot.valid if shot.valid.ndim == 2 else shot.valid.all(-1)
    expected = (
        image > 0 if width is None else cv2.resize(image, (32, 24), interpolation=cv2.INTER_AREA) == 255
    )
    np.testing.assert_array_equal(kept, expected)
    others = [other for view in views for other in view.shots if other.file != file]
    assert all(other.valid.all() for other in others)


@pytest.mark.parametrize(
    ("image", "sentence"),
    [
        (None, "first.png cannot be read .no such file"),
        (np.zeros((24, 32), np.uint8), "first.png has 32x24 pixels and its photograph 64x48"),
    ],
)
def test_a_mask_that_cannot_be_used_is_told(session_copy, image, sentence):
    masked_session(session_copy, image)
    with pytest.raises(InputError, match=sentence):
        load(session_copy)


def test_a_damaged_mask_is_told(tmp_path):
    whole = cv2.imencode(".png", np.eye(40, dtype=np.uint8))[1].tobytes()
    (tmp_path / "m.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"m\.png is damaged"):
        read_mask(tmp_path / "m.png", 40, 40)
    (tmp_path / "m.png").write_bytes(b"\x89PNG nothing")
    with pytest.raises(InputError, match=r"m\.png is not a JPEG, PNG or TIFF file"):
        read_mask(tmp_path / "m.png", 40, 40)


def test_colour_and_alpha_of_a_mask(tmp_path):
    """Any colour counts as seen, where it is opaque."""
    image = np.zeros((2, 3, 4), np.uint8)
    image[..., 3] = 255
    image[0, 1, 2] = 1
    cv2.imwrite(str(tmp_path / "m.png"), image)
    assert read_mask(tmp_path / "m.png", 2, 3).tolist() == [[False, True, False], [False] * 3]
