"""Path-traced light without grain: of matte surfaces it is traced once, into their textures.

A path tracer's noise differs from view to view, which no scene can show; at the samples that a test can pay
for it would drown the sensor's. So the light that falls on each matte panel (global illumination included)
is traced on a coarse grid, smoothed, and is from then on what the panel sends out. What depends on the
direction (metal, mirror, glass) is traced in every view, among panels that shine; it converges quickly,
since all that it meets is light.
"""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from imaging.arrays import AnyArray, Array, Array32, Bytes, Mask

from .scenes import CACHE, VARIANT, Shape, _bytes, _shape

BOUNCES = 6
"""Longest path, in segments."""
MORE = 8
"""Times the samples of a pixel where metal or glass is."""
BRIGHTEST = 3e4
"""Largest half float, about."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A matte rectangle: place [4, 4] takes (-1..1, -1..1, 0) to the world, it faces along z.

    reflectance: [rows, columns, 3]. texels: grid of its light, columns and rows.
    """

    place: Array
    reflectance: Array32
    texels: tuple[int, int] = (24, 24)


@dataclass(frozen=True, eq=False)
class LitScene:
    """panels and other shapes (lamps, metal, glass), by name; probe: light from all around, or none.

    angle: degrees across a picture. samples: of a pixel. traced: samples of a texel of a panel's light.
    """

    name: str
    panels: Mapping[str, Panel]
    shapes: Mapping[str, Shape]
    poses: Array
    probe: Array32 | None = None
    angle: float = 50.0
    width: int = 160
    height: int = 120
    samples: int = 9
    traced: int = 64

    @property
    def focal(self) -> float:
        """px; the middle of the picture is where the axis meets it."""
        return float(self.width / 2 / np.tan(np.radians(self.angle / 2)))

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts that `shown` counts; 0 is the background."""
        return ("background", *self.panels, *self.shapes)

    def light(self) -> Array32:
        """Radiance [V, H, W, 3] of every view."""
        return np.asarray(self._traced["light"], np.float32)

    def shown(self) -> Bytes:
        """Part in the middle of each pixel, [V, H, W]."""
        return np.asarray(self._traced["seen"])

    def where(self, *names: str) -> Mask:
        """Pixels [V, H, W] that show a part whose name begins with one of these."""
        return np.isin(self.shown(), [n for n, part in enumerate(self.parts) if part.startswith(names)])

    def surface_points(self, count: int = 1500) -> Array:
        """Points [count, 3] on the panels, a few thousandths off, as structure from motion leaves them."""
        rng = np.random.default_rng(7)
        places = np.stack([panel.place for panel in self.panels.values()])
        areas = np.linalg.norm(places[:, :3, :2], axis=1).prod(axis=1)
        chosen = rng.choice(len(places), count, p=areas / areas.sum())
        flat = [rng.uniform(-1, 1, (count, 2)), np.zeros((count, 1)), np.ones((count, 1))]
        world = np.einsum("nij,nj->ni", places[chosen], np.concatenate(flat, axis=1))[:, :3]
        return np.asarray(world + 0.005 * rng.standard_normal(world.shape))

    @cached_property
    def _traced(self) -> dict[str, AnyArray]:
        file = CACHE / f"{self.name}-{self._hash()}.npz"
        if not file.exists():
            self._trace(file)
        with np.load(file) as arrays:
            return {name: arrays[name] for name in arrays.files}

    @cached_property
    def _greys(self) -> dict[str, list[float]]:
        """Mean reflectance of each panel."""
        return {name: panel.reflectance.mean((0, 1)).tolist() for name, panel in self.panels.items()}

    def _hash(self) -> str:
        settings = (self.width, self.height, self.samples, self.traced, self.angle, BOUNCES, MORE, BRIGHTEST)
        digest = hashlib.sha256(repr(settings).encode() + self.poses.tobytes())
        if self.probe is not None:
            digest.update(np.ascontiguousarray(self.probe).tobytes())
        for name, panel in self.panels.items():
            digest.update(name.encode() + panel.place.tobytes() + panel.reflectance.tobytes())
            digest.update(repr(panel.texels).encode())
        for name, shape in self.shapes.items():
            digest.update(name.encode() + _bytes(shape))
        return digest.hexdigest()[:12]

    def _trace(self, file: Path) -> None:
        import mitsuba

        mitsuba.set_variant(VARIANT)
        mitsuba.set_log_level(mitsuba.LogLevel.Error)  # it warns of rounding the number of samples up
        panels = {name: self._shining(name) for name in self.panels}
        world = self._world({**panels, **{name: _shape(shape) for name, shape in self.shapes.items()}})
        parts = self._world({name: self._flat(number) for number, name in enumerate(self.parts) if number}, 1)
        light, shapes = [], []
        for number, pose in enumerate(self.poses):
            whole = 0, 0, self.width, self.height
            which = mitsuba.render(parts, sensor=self._camera(pose, whole, 1), seed=number)
            shapes.append(np.rint(np.asarray(which)[..., 0]).astype(np.uint8))
            windows = [whole, *self._glossy(shapes[-1])]
            picture = np.zeros((self.height, self.width, 3), np.float32)
            for window in windows:
                left, top, width, height = window
                samples = self.samples * (1 if window is whole else MORE)
                drawn = mitsuba.render(world, sensor=self._camera(pose, window, samples), seed=number)
                picture[top : top + height, left : left + width] = np.asarray(drawn)[..., :3]
            light.append(np.clip(picture, 0, BRIGHTEST).astype(np.float16))
        file.parent.mkdir(parents=True, exist_ok=True)
        part = file.with_suffix(f".{os.getpid()}.npz")
        np.savez(part, light=np.stack(light), seen=np.stack(shapes))
        part.replace(file)

    def _world(self, shapes: Mapping[str, Any], bounces: int = BOUNCES) -> Any:
        import mitsuba

        world = {"type": "scene", "integrator": {"type": "path", "max_depth": bounces}, **shapes}
        if self.probe is not None and bounces > 1:
            world["probe"] = {
                "type": "envmap",
                "bitmap": mitsuba.Bitmap(np.ascontiguousarray(self.probe)),
                "to_world": mitsuba.ScalarTransform4f().rotate([1, 0, 0], 90),
            }
        return mitsuba.load_dict(world)

    def _glossy(self, shapes: Bytes) -> list[tuple[int, int, int, int]]:
        """Windows (left, top, width, height) around metal and glass in a view, where paths part."""
        boxes = []
        for name, shape in self.shapes.items():
            rows, columns = np.nonzero(shapes == self.parts.index(name))
            if len(rows) and "emitter" not in shape:
                left, top = max(0, columns.min() - 1), max(0, rows.min() - 1)
                right, bottom = min(self.width, columns.max() + 2), min(self.height, rows.max() + 2)
                boxes.append((int(left), int(top), int(right - left), int(bottom - top)))
        return boxes

    def _camera(self, pose: Array, window: tuple[int, int, int, int], samples: int) -> Any:
        import mitsuba

        # Mitsuba's camera looks along z as ours does, but with x to the left and y up.
        turned = np.linalg.inv(pose) @ np.diag([-1.0, -1.0, 1.0, 1.0])
        return mitsuba.load_dict(
            {
                "type": "perspective",
                "fov": self.angle,
                "fov_axis": "x",
                "near_clip": 0.01,
                "to_world": mitsuba.ScalarTransform4f(turned),
                "film": _film(self.width, self.height, window),
                "sampler": {"type": "multijitter", "sample_count": samples},
            }
        )

    def _shining(self, name: str) -> dict[str, Any]:
        """A panel as Mitsuba has it that sends out what it would reflect."""
        import mitsuba

        panel = self.panels[name]
        rows, columns = panel.reflectance.shape[:2]
        # Texels of the grid are areas: resizing keeps their middles in place.
        light = cv2.resize(self._falling(name), (columns, rows), interpolation=cv2.INTER_LINEAR)
        return {
            "type": "rectangle",
            "to_world": mitsuba.ScalarTransform4f(panel.place),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
            "emitter": {
                "type": "area",
                "sampling_weight": 0.0,  # there are too many to be drawn from one by one: what is met counts
                "radiance": {
                    "type": "bitmap",
                    "bitmap": mitsuba.Bitmap(
                        np.ascontiguousarray(light * panel.reflectance, dtype=np.float32)
                    ),
                    "raw": True,
                    "wrap_mode": "clamp",
                },
            },
        }

    def _falling(self, name: str) -> Array32:
        """Radiance of a white panel in the place of this one, [rows, columns, 3], smoothed."""
        import mitsuba

        panels = {
            other: {
                "type": "rectangle",
                "to_world": mitsuba.ScalarTransform4f(panel.place),
                "bsdf": {
                    "type": "diffuse",
                    "reflectance": {
                        "type": "rgb",
                        "value": [1.0] * 3 if other == name else self._greys[other],
                    },
                },
            }
            for other, panel in self.panels.items()
        }
        world = self._world({**panels, **{key: _shape(shape) for key, shape in self.shapes.items()}})
        panel = self.panels[name]
        # An orthographic camera right before the panel, which sees nothing else.
        across, up = panel.place[:3, 0], panel.place[:3, 1]
        normal = np.cross(across, up)
        normal /= np.linalg.norm(normal)
        columns, rows = panel.texels
        camera = np.eye(4)
        camera[:3, :3] = np.stack([-across, up * columns / rows, -normal], axis=1)
        camera[:3, 3] = panel.place[:3, 3] + 2e-3 * normal
        sensor = mitsuba.load_dict(
            {
                "type": "orthographic",
                "near_clip": 1e-4,
                "to_world": mitsuba.ScalarTransform4f(camera),
                "film": _film(columns, rows, (0, 0, columns, rows)),
                "sampler": {"type": "independent", "sample_count": self.traced},
            }
        )
        seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "little")
        light = np.asarray(mitsuba.render(world, sensor=sensor, seed=seed), np.float32)[::-1, :, :3]
        light = np.stack([cv2.medianBlur(np.ascontiguousarray(light[..., c]), 3) for c in range(3)], -1)
        return np.asarray(cv2.GaussianBlur(light, (0, 0), 0.8), np.float32)

    def _flat(self, number: int) -> dict[str, Any]:
        """A part that shines with its number."""
        import mitsuba

        name = self.parts[number]
        emitter = {"type": "area", "radiance": {"type": "rgb", "value": float(number)}}
        if name in self.panels:
            place = mitsuba.ScalarTransform4f(self.panels[name].place)
            return {"type": "rectangle", "to_world": place, "emitter": emitter}
        geometry = {key: value for key, value in self.shapes[name].items() if key not in ("bsdf", "emitter")}
        return {**_shape(geometry), "emitter": emitter}


def _film(width: int, height: int, window: tuple[int, int, int, int]) -> dict[str, Any]:
    left, top, across, down = window
    return {
        "type": "hdrfilm",
        "width": width,
        "height": height,
        "crop_offset_x": left,
        "crop_offset_y": top,
        "crop_width": across,
        "crop_height": down,
        "rfilter": {"type": "box"},
        "component_format": "float32",
    }
