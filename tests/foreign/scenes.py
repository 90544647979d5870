"""Path-traced scenes that no part of the project had a hand in: Mitsuba's light, cameras in known places.

Poses are cam_from_world, OpenCV's axes (x right, y down, z forward); the world's z points up. Lengths are in
units of the object, which is about two across.
"""

import hashlib
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import fft

from imaging.arrays import Array, Array32

Shape = dict[str, Any]

CACHE = Path(os.environ.get("RIG_FOREIGN", Path(tempfile.gettempdir()) / "hdr-rig-foreign"))
"""Folder of the rendered pictures, by a hash of the scene."""
VARIANT = os.environ.get("RIG_MITSUBA", "scalar_rgb")
"""Variant of Mitsuba; llvm_ad_rgb is faster, and needs LLVM 16 or newer."""
FIELD = 50.0
"""Degrees across a picture."""
DEPTH = 4
"""Longest path: light, two bounces, camera."""


@dataclass(frozen=True, eq=False)
class Scene:
    """shapes: of Mitsuba, by name. probe: light from all around, float32 [H, W, 3]; it is seen, too.

    poses: cam_from_world [V, 4, 4] of the views.
    """

    name: str
    shapes: Mapping[str, Shape]
    probe: Array32
    poses: Array
    width: int = 400
    height: int = 300
    samples: int = 32

    @property
    def focal(self) -> float:
        """px; the middle of the picture is where the axis meets it."""
        return float(self.width / 2 / np.tan(np.radians(FIELD / 2)))

    def light(self) -> Array32:
        """Radiance [V, H, W, 3] of every view, path-traced, or taken from the cache."""
        file = CACHE / f"{self.name}-{self._hash()}.npz"
        if not file.exists():
            light = self._traced()
            file.parent.mkdir(parents=True, exist_ok=True)
            part = file.with_suffix(f".{os.getpid()}.npz")
            np.savez(part, light=light.astype(np.float16))
            part.replace(file)
        with np.load(file) as arrays:
            return np.asarray(arrays["light"], np.float32)

    def _hash(self) -> str:
        digest = hashlib.sha256(repr((self.width, self.height, self.samples, FIELD, DEPTH)).encode())
        for part in (self.probe, self.poses):
            digest.update(np.ascontiguousarray(part).tobytes())
        for name, shape in sorted(self.shapes.items()):
            digest.update(name.encode() + _bytes(shape))
        return digest.hexdigest()[:12]

    def _traced(self) -> Array32:
        import mitsuba

        mitsuba.set_variant(VARIANT)
        world = mitsuba.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "path", "max_depth": DEPTH},
                "probe": {
                    "type": "envmap",
                    "bitmap": mitsuba.Bitmap(np.ascontiguousarray(self.probe)),
                    "to_world": mitsuba.ScalarTransform4f().rotate([1, 0, 0], 90),
                },
                **{name: _shape(shape) for name, shape in self.shapes.items()},
            }
        )
        film = {
            "type": "hdrfilm",
            "width": self.width,
            "height": self.height,
            "rfilter": {"type": "box"},
            "component_format": "float32",
        }
        pictures = []
        for number, pose in enumerate(self.poses):
            # Mitsuba's camera looks along z as ours does, but with x to the left and y up.
            turned = np.linalg.inv(pose) @ np.diag([-1.0, -1.0, 1.0, 1.0])
            sensor = mitsuba.load_dict(
                {
                    "type": "perspective",
                    "fov": FIELD,
                    "fov_axis": "x",
                    "near_clip": 0.01,
                    "to_world": mitsuba.ScalarTransform4f(turned),
                    "film": film,
                    "sampler": {"type": "independent", "sample_count": self.samples},
                }
            )
            picture = mitsuba.render(world, sensor=sensor, seed=number)
            pictures.append(np.clip(np.asarray(picture, np.float32)[..., :3], 0, 3e4))
        return np.stack(pictures)


def _bytes(shape: Any) -> bytes:
    if isinstance(shape, np.ndarray):
        return np.ascontiguousarray(shape).tobytes()
    if isinstance(shape, dict):
        return b"".join(key.encode() + _bytes(value) for key, value in sorted(shape.items()))
    return repr(shape).encode()


def _shape(shape: Shape) -> dict[str, Any]:
    """Shape for Mitsuba, of arrays as textures and [4, 4] matrices as places."""
    import mitsuba

    made: dict[str, Any] = {}
    for key, value in shape.items():
        if isinstance(value, dict):
            made[key] = _shape(value)
        elif isinstance(value, np.ndarray) and value.shape == (4, 4):
            made[key] = mitsuba.ScalarTransform4f(value)
        elif isinstance(value, np.ndarray):
            made[key] = mitsuba.Bitmap(np.ascontiguousarray(value, np.float32))
        else:
            made[key] = value
    return made


def surface(texture: Array32, *, gloss: float = 0.0, repeat: tuple[int, int] = (1, 1)) -> Shape:
    """A BSDF of a reflectance [H, W, 3]; gloss: roughness of a varnish over it, none if 0."""
    scaled = np.diag([float(repeat[0]), float(repeat[1]), 1.0, 1.0])
    colour: Shape = {"type": "bitmap", "bitmap": texture, "raw": True, "to_uv": scaled}
    if gloss:
        varnished: Shape = {"type": "roughplastic", "alpha": gloss, "diffuse_reflectance": colour}
        return {"type": "twosided", "bsdf": varnished}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": colour}}


def spots(seed: int, size: int = 512, contrast: float = 1.0) -> Array32:
    """A texture [size, size, 3] like no other of another seed: coloured blots from large to small."""
    rng = np.random.default_rng(seed)
    texture = np.full((size, size, 3), 0.4, np.float32)
    for blot in np.geomspace(size / 8, size / 128, 5):
        grey, *colour = _blurred(rng.standard_normal((4, size, size)).astype(np.float32), float(blot) / 2)
        grey *= np.float32(3 / grey.std())
        scale = np.float32(1.5 / np.std(colour))
        for channel, tint in enumerate(colour):
            texture[..., channel] += np.float32(0.12 * contrast) * np.tanh(grey + scale * tint)
    return np.clip(texture, 0.04, 0.9)


def _blurred(images: Array32, sigma: float) -> Array32:
    """Square images [N, S, S] that repeat, under a Gaussian cut off at four sigmas: by FFT, as it is wide."""
    size, reach = images.shape[-1], round(4 * sigma)
    steps = np.arange(-reach, reach + 1)
    kernel = np.bincount(steps % size, np.exp(-0.5 * (steps / sigma) ** 2), minlength=size)
    passed = fft.fft(kernel / kernel.sum()).real.astype(np.float32)
    spectrum = fft.rfft2(images) * passed[:, None] * passed[: size // 2 + 1]
    return np.asarray(fft.irfft2(spectrum, (size, size)), np.float32)


def plain(value: float = 0.5) -> Array32:
    """A texture without any."""
    return np.full((4, 4, 3), value, np.float32)


def windows(seed: int = 0, height: int = 128) -> Array32:
    """A light probe [height, 2 height, 3]: a dim hall with a few bright windows, all different."""
    from scipy import ndimage

    rng = np.random.default_rng(seed)
    probe = np.full((height, 2 * height, 3), 0.15)
    for _ in range(9):
        row, column = rng.integers(height // 6, height // 2), rng.integers(0, 2 * height)
        tall, wide = rng.integers(4, 14, 2)
        columns = np.arange(column, column + wide) % (2 * height)
        probe[row : row + tall, columns] = rng.uniform(1, 12) * rng.uniform(0.7, 1, 3)
    probe *= np.exp(
        0.4 * ndimage.gaussian_filter(rng.standard_normal(probe.shape), (2, 2, 0), mode="wrap") * 4
    )
    return probe.astype(np.float32)


def moved(
    x: float, y: float, z: float, *, turn: float = 0.0, size: Sequence[float] = (1.0, 1.0, 1.0)
) -> Array:
    """world_from_shape [4, 4]: scaled, turned about the vertical by degrees, then moved."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    place = np.eye(4)
    place[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.diag(size)
    place[:3, 3] = x, y, z
    return place


def upright(turn: float) -> Array:
    """Turns a rectangle, which faces up z, to stand and face that many degrees about the vertical."""
    stood = np.array([[0, 0, 1.0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    return moved(0, 0, 0, turn=turn) @ stood


def box(name: str, sides: Sequence[Shape], top: Shape, place: Array) -> dict[str, Shape]:
    """A box two units across before `place`, of BSDFs of its four sides and its top, as rectangles."""
    made = {}
    for number, side in enumerate(sides):
        turn = 90.0 * number
        shift = np.eye(4)
        shift[:3, 3] = np.cos(np.radians(turn)), np.sin(np.radians(turn)), 0
        made[f"{name}_{number}"] = {
            "type": "rectangle",
            "to_world": place @ shift @ upright(turn),
            "bsdf": side,
        }
    made[f"{name}_top"] = {"type": "rectangle", "to_world": place @ moved(0, 0, 1), "bsdf": top}
    return made


def floor(bsdf: Shape, half: float = 4.0, z: float = -1.0) -> dict[str, Shape]:
    """A square floor."""
    return {"floor": {"type": "rectangle", "to_world": moved(0, 0, z, size=(half, half, 1)), "bsdf": bsdf}}


def look_at(centre: Sequence[float], target: Sequence[float]) -> Array:
    """cam_from_world [4, 4] of an upright camera."""
    ahead = np.subtract(target, centre)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead])
    pose[:3, 3] = -pose[:3, :3] @ np.asarray(centre, np.float64)
    return pose


def ring(
    count: int,
    radius: float = 4.0,
    height: float = 1.2,
    *,
    span: float = 360.0,
    target: Sequence[float] = (0.0, 0.0, 0.0),
    outwards: bool = False,
    seed: int = 0,
) -> Array:
    """Poses [count, 4, 4] all around the middle, a little uneven as by hand."""
    rng = np.random.default_rng(seed)
    poses = []
    for number in range(count):
        turn = np.radians(span * number / (count if span == 360.0 else count - 1) + rng.normal(0, 1.5))
        away = radius * (1 + rng.normal(0, 0.03))
        centre = np.array([away * np.cos(turn), away * np.sin(turn), height + rng.normal(0, 0.1)])
        goal = np.asarray(target, np.float64) + rng.normal(0, 0.05, 3)
        if outwards:
            goal = np.array([2 * centre[0], 2 * centre[1], centre[2]]) + rng.normal(0, 0.05, 3)
        poses.append(look_at(centre, goal))
    return np.stack(poses)


def line(count: int, length: float, away: float, height: float = 0.3, *, seed: int = 0) -> Array:
    """Poses [count, 4, 4] along y before a wall at x = 0, looking at it."""
    rng = np.random.default_rng(seed)
    places = np.linspace(-length / 2, length / 2, count)
    return np.stack(
        [
            look_at(
                [away + rng.normal(0, 0.1), y + rng.normal(0, 0.05), height + rng.normal(0, 0.15)],
                [0.0, y + rng.normal(0, 0.2), rng.normal(0, 0.1)],
            )
            for y in places
        ]
    )
