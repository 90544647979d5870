"""Data layers of a scene as pictures: distance, orientation, number of photographs."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from imaging.arrays import Array32, Bytes
from imaging.errors import InputError
from recon.result.model import CALIBRATION, read_own_calibration
from recon.result.scene import Scene
from rig.terminal.text import number
from rig.view.pictures.look import ramp

LayerName = Literal["depth", "normal", "trust"]
TRUST: LayerName = "trust"
LAYERS: tuple[LayerName, ...] = get_args(LayerName)

NEAREST, FARTHEST = 0.125, 8.0
"""Ends of the colours of depth, in distances of what the photographs look at."""
MOST_PHOTOGRAPHS = 16


@dataclass(frozen=True)
class _Shown:
    """Display of a layer of a scene: its colours, their legend, and a value in words."""

    picture: Callable[[Array32, Scene], Bytes]
    legend: Callable[[Scene], str]
    words: Callable[[Array32, Scene], str]


def picture_of(name: LayerName, plane: Array32, scene: Scene) -> Bytes:
    """A layer, [H, W] or [H, W, 3], for a screen, uint8 [H, W, 3]; black: nothing there."""
    return _SHOWN[name].picture(plane, scene)


def legend_of(name: LayerName, scene: Scene) -> str:
    """Return what the colours of a layer mean, from dark blue to dark red."""
    return _SHOWN[name].legend(scene)


def words_of(name: LayerName, value: Array32, scene: Scene) -> str:
    """Return what a layer says of one pixel."""
    return _SHOWN[name].words(value, scene)


def _most(scene: Scene) -> int:
    return min(max(len(scene.record.training_views), 2), MOST_PHOTOGRAPHS)


def _depth(plane: Array32, scene: Scene) -> Bytes:
    near, far = (np.log2(end * scene.record.world.unit) for end in (NEAREST, FARTHEST))
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.asarray((np.log2(plane) - near) / (far - near), np.float32)
    return ramp(place.astype(np.float32), np.isfinite(place))


def _depth_legend(scene: Scene) -> str:
    near, far = (number(end * scene.record.world.unit) for end in (NEAREST, FARTHEST))
    return f"{near} to {far} {unit_of(scene)} away"


def _depth_words(value: Array32, scene: Scene) -> str:
    return f"{number(float(value))} {unit_of(scene)} away" if np.isfinite(value) else "nothing there"


def _normal(plane: Array32, scene: Scene) -> Bytes:
    there = np.abs(plane).sum(axis=2, keepdims=True) > 0
    return np.where(there, np.uint8(np.round(127.5 * (np.clip(plane, -1, 1) + 1))), np.uint8(0))


def _normal_words(value: Array32, scene: Scene) -> str:
    return "normal " + ", ".join(f"{part:+.2f}" for part in value) if value.any() else "no surface"


def _trust(plane: Array32, scene: Scene) -> Bytes:
    return ramp(plane / np.float32(_most(scene)), plane > 0)


def _trust_words(value: Array32, scene: Scene) -> str:
    return f"**{float(value):.1f} photographs** saw it above their noise"


def unit_of(scene: Scene) -> str:
    """Unit of lengths, as the calibration of the scene has it; without a name if arbitrary."""
    try:
        return _unit(scene.folder, (scene.folder / CALIBRATION).stat().st_mtime_ns)
    except (InputError, OSError):  # a scene that is still trained has none yet
        return "units"


@cache
def _unit(folder: Path, written: int) -> str:
    """Unit of the calibration that was written into a folder at that time."""
    return "m" if read_own_calibration(folder).unit == "m" else "units"


_SHOWN: dict[str, _Shown] = {
    "depth": _Shown(_depth, _depth_legend, _depth_words),
    "normal": _Shown(_normal, lambda scene: "", _normal_words),
    "trust": _Shown(
        _trust, lambda scene: f"0 to {_most(scene)} photographs that saw it above their noise", _trust_words
    ),
}
