"""True albedo and irradiance of what is matte in the pictures of a lit scene."""

from dataclasses import dataclass

import cv2
import numpy as np

from imaging.arrays import Array32

from .lit import LitScene
from .scenes import CACHE


@dataclass(frozen=True, eq=False)
class Matte:
    """albedo, irradiance [V, H, W, 3], averages over each pixel; NaN at edges and at what is not matte."""

    albedo: Array32
    irradiance: Array32


def matte(scene: LitScene) -> Matte:
    """Albedo is the traced light over the irradiance of the panel that fills a pixel, traced and smoothed."""
    falling, shown, light = _falling(scene), scene.shown(), scene.light()
    radiance = np.full(light.shape, np.nan, np.float32)
    height, width = shown.shape[1:]
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
    rays = np.stack([x, y, np.full(x.shape, scene.focal)], -1)
    for number, pose in enumerate(scene.poses):
        parts = shown[number]
        around = np.ones((3, 3), np.uint8)
        inner = cv2.erode(parts, around) == cv2.dilate(parts, around)
        centre, turned = np.linalg.inv(pose)[:3, 3], rays @ pose[:3, :3]
        for name, panel in scene.panels.items():
            here = inner & (parts == scene.parts.index(name))
            if not here.any():
                continue
            local = np.linalg.inv(panel.place)
            origin, ahead = local[:3, :3] @ centre + local[:3, 3], turned[here] @ local[:3, :3].T
            across = origin + ahead * (-origin[2] / ahead[:, 2])[:, None]
            rows, columns = falling[name].shape[:2]
            # Texels are areas, the first row at y = -1.
            column = ((across[:, 0] + 1) / 2 * columns - 0.5).astype(np.float32)
            row = ((across[:, 1] + 1) / 2 * rows - 0.5).astype(np.float32)
            radiance[number, here] = cv2.remap(
                falling[name],
                column[:, None],
                row[:, None],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_REPLICATE,
            )[:, 0]
    return Matte(light / np.maximum(radiance, 1e-9), np.float32(np.pi) * radiance)


def _falling(scene: LitScene) -> dict[str, Array32]:
    """Radiance of a white panel in place of each, [rows, columns, 3], traced, or taken from the cache."""
    file = CACHE / f"{scene.name}-{scene._hash()}-falling.npz"
    if not file.exists():
        import mitsuba

        from .scenes import VARIANT

        mitsuba.set_variant(VARIANT)
        scene.light()  # makes the folder, too
        np.savez(file, **{name: scene._falling(name) for name in scene.panels})
    with np.load(file) as arrays:
        return {name: arrays[name] for name in arrays.files}
