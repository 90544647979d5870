"""A first look at the scene's light: the bracket of a view as one linear Rec.709 image."""

import math
import weakref
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

import numpy as np

from imaging.arrays import Array32, Mask
from imaging.colour.spaces import rec709_from_camera
from imaging.compute.threads import in_turn
from imaging.demosaicking.demosaic import demosaic
from imaging.files import store
from imaging.merge.bracket import merge_bracket
from imaging.merge.linear_frame import LinearFrame
from imaging.progress import Progress, unreported
from imaging.sensor.cfa import bilinear
from recon.data.dataset import Dataset, View


@dataclass(frozen=True)
class Light:
    """The two scalars that tie a model to the light of its scene, stored with it.

    normaliser: radiance that counts as 1 in scene units. reference: the dimmest radiance that
    matters, in scene units; None for display values, which end where a display does.
    """

    normaliser: float
    reference: float | None


Images = Sequence[tuple[Array32, Mask]]
"""Radiance images of views, in their order; for a large data set each access reads a file."""

MERGERS = 4
"""Brackets at most that are merged at once: each takes several times the memory of its picture."""
BRIGHTEST = 0.9999
"""Share of the pixels that are darker than light of 1 in scene units."""
_STEP = {"raw": 1 / 4095, "ldr": 1 / 255, "hdr": 0.0}


def radiance_image(view: View) -> tuple[Array32, Mask]:
    """Linear radiance [H, W, channels] and where it is trusted [H, W]: the merged bracket, demosaicked.

    Where all shots are saturated the shortest gives a lower bound, which is returned but not trusted. Of a
    band that the view has no shot of, the light is NaN. It serves to start the Gaussians and to set the
    scene's scale; training compares with the shots.
    """
    sensor = view.sensor
    if view.shots[0].band is not None:
        return _of_bands(view)
    response = sensor.response if sensor.kind == "ldr" else None
    merged = merge_bracket([shot.linear(response, sensor.cfa) for shot in view.shots])
    light = np.nan_to_num(merged.radiance, nan=0.0, posinf=0.0, neginf=0.0)
    if sensor.cfa is not None:
        sigma = None if merged.sigma is None else merged.sigma / sensor.falloff
        rgb = demosaic(light / sensor.falloff, sensor.cfa, sigma=sigma, spread=False).rgb
        trusted = bilinear(light, sensor.cfa, merged.valid)[1]
    else:
        developed = sensor.falloff[..., None] * np.array(sensor.white_balance, np.float32)
        rgb, trusted = light / developed, merged.valid
    linear = rgb @ rec709_from_camera(sensor.camera_from_rec709).T
    return np.asarray(linear, np.float32), np.asarray(trusted.all(-1))


def radiance_images(dataset: Dataset, progress: Progress = unreported) -> Images:
    """Radiance images of the training views: in memory if their shots are, else in a temporary file without a
    name.
    """

    def each() -> Iterator[tuple[Array32, Mask]]:
        if all(view.held for view in dataset.train):
            yield from in_turn(len(dataset.train), lambda turn: radiance_image(dataset.train[turn]), MERGERS)
            return
        for done, view in enumerate(dataset.train):
            if not view.held:
                progress("merging brackets", done, len(dataset.train))
            yield radiance_image(view)

    return kept_images(dataset, each())


def kept_images(dataset: Dataset, images: Iterable[tuple[Array32, Mask]]) -> Images:
    """Images of views, in memory if the shots of the data set are."""
    held = all(view.held for view in dataset.views)
    return list(images) if held else StoredImages(dataset.session, images)


class StoredImages(Sequence[tuple[Array32, Mask]]):
    """Images [H, W, C] with masks [H, W] on a disk, which are freed with the last reference."""

    def __init__(self, folder: Path, images: Iterable[tuple[Array32, Mask]]) -> None:
        self._file = store.scratch(folder)
        weakref.finalize(self, self._file.close)
        self._places: list[tuple[int, tuple[int, ...]]] = []
        place = 0
        try:
            for light, trusted in images:
                self._places.append((place, light.shape))
                self._file.write(np.ascontiguousarray(light, np.float32).data)
                self._file.write(np.ascontiguousarray(trusted).data)
                place = self._file.tell()
        except OSError as error:
            raise store.refused(folder, error) from error

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, at: int) -> tuple[Array32, Mask]: ...
    @overload
    def __getitem__(self, at: slice) -> list[tuple[Array32, Mask]]: ...
    def __getitem__(self, at: int | slice) -> tuple[Array32, Mask] | list[tuple[Array32, Mask]]:
        if isinstance(at, slice):
            return [self[place] for place in range(*at.indices(len(self)))]
        place, shape = self._places[at]
        self._file.seek(place)
        light, trusted = np.empty(shape, np.float32), np.empty(shape[:2], bool)
        self._file.readinto(light.data)
        self._file.readinto(trusted.data)
        return light, trusted


def _of_bands(view: View) -> tuple[Array32, Mask]:
    """The same of shots through filters, each band's bracket merged by itself."""
    groups: dict[int, list[LinearFrame]] = {}
    for shot in view.shots:
        assert shot.band is not None
        groups.setdefault(shot.band, []).append(shot.linear(None, view.sensor.cfa))
    light = np.full((*view.shots[0].pixels.shape, view.channels), np.nan, np.float32)
    trusted = np.ones(view.shots[0].pixels.shape, bool)
    for band, frames in groups.items():
        merged = merge_bracket(frames)
        light[..., band] = (
            np.nan_to_num(merged.radiance, nan=0.0, posinf=0.0, neginf=0.0) / view.sensor.falloff
        )
        trusted &= merged.valid
    return light, trusted


def grey(image: Array32) -> Array32:
    """The mean of the channels [H, W] that a radiance image has."""
    known = ~np.isnan(image[0, 0])
    return np.asarray((image if known.all() else image[..., known]).mean(-1), np.float32)


def light_of(dataset: Dataset, images: Images) -> Light:
    """The two scalars of a scene, from the radiance images of its training views.

    normaliser: the 99.99th percentile of the largest channel, so that a hot pixel does not set it; 1
    for a scene without any light. reference: one code value (of 12 bits for linear input, of 8 for
    photographs) of the longest exposures, the least that they can distinguish from black, but not less
    than 2^-20 of the normaliser, which is what it is for EXR, whose numbers have no steps.
    """
    top = _brightest(images, sum(view.lens.width * view.lens.height for view in dataset.train))
    normaliser = top if np.isfinite(top) and top > 0 else 1.0
    steps = [_STEP[view.sensor.kind] / max(shot.k for shot in view.shots) for view in dataset.train]
    return Light(normaliser, float(np.clip(np.median(steps) / normaliser, 2.0**-20, 1.0)))


def _brightest(images: Images, pixels: int) -> float:
    """Percentile of that many pixels, of which only those above it are ever held together."""
    place = BRIGHTEST * (pixels - 1)
    above = pixels - math.floor(place)
    largest = np.empty(0, np.float32)
    for light, _ in images:
        values = np.fmax.reduce([light[..., channel] for channel in range(light.shape[-1])]).reshape(-1)
        if len(largest) == above:  # most are below all that are held
            values = values[~(values <= largest.min())]
        both = np.concatenate([largest, values])
        largest = np.partition(both, len(both) - above)[-above:] if len(both) > above else both
    low, high = np.sort(largest)[:2].astype(np.float64) if len(largest) > 1 else (*largest, *largest)
    return float(low + (high - low) * (place - math.floor(place)))
