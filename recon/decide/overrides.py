"""User's overrides of the preset and the method of a training."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Self, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from imaging.errors import InputError
from imaging.record import Record

if TYPE_CHECKING:
    from recon.data.dataset import Dataset, View
    from recon.data.shot import Shot
    from recon.methods.method import Method

T = TypeVar("T")

_WHAT = "(poses|exposures|vignetting|glare)"
_REFINE = rf"^(none|{_WHAT}(\+{_WHAT})*)$"
_STATED = "(exposure|white_balance)"
_OVERRULE = rf"^(none|{_STATED}(\+{_STATED})*)$"


class Overrides(Record):
    """Settings by name; None: the preset's or the method's. The fields are the keys of `--set`."""

    iterations: int | None = Field(default=None, ge=1, le=10_000_000)
    gaussians: int | None = Field(default=None, ge=16, le=100_000_000)
    """Maximum number of Gaussians."""
    width: int | None = Field(default=None, ge=16, le=100_000)
    """Wider images are scaled down to it, px."""
    degree: int | None = Field(default=None, ge=0, le=2)
    """Degree of the harmonics that make colours depend on the direction."""
    ssim: float | None = Field(default=None, ge=0, le=1)
    """Weight of SSIM in the loss; the rest is L1."""
    growth: float | None = Field(default=None, ge=0, le=0.95)
    """Share of the Gaussians that training does not begin with but grows."""
    views: int | None = Field(default=None, ge=1)
    """Number of training views in use, evenly chosen."""
    exposures: int | None = Field(default=None, ge=1)
    """Number of shots of each training view's bracket in use, evenly chosen; of a filter wheel, of each
    band."""
    refine: str | None = Field(default=None, pattern=_REFINE)
    """Corrections of the calibration by training, joined by +, or none."""

    environment: bool | None = None
    """Light from far away behind the Gaussians, a radiance by direction: 1 or 0."""
    depth: float | None = Field(default=None, ge=0, le=100)
    """Weight of measured depth in the loss; 0: depth maps are left out, at the start, too."""
    overrule: str | None = Field(default=None, pattern=_OVERRULE)
    """Parts of the photographs' light in which scene points overrule the files, joined by +, or none."""

    @classmethod
    def of(cls, words: Sequence[str]) -> Self:
        """Parse `KEY=VALUE`, such as `iterations=500`; InputError if a key or a value is not possible."""
        pairs = [word.partition("=") for word in words]
        for word, (key, _, value) in zip(words, pairs, strict=True):
            if key not in cls.model_fields or not value:
                raise InputError(
                    f"--set {word} is not a setting: write KEY=VALUE with one of "
                    f"{', '.join(cls.model_fields)}."
                )
        keys = [key for key, _, _ in pairs]
        if twice := {key for key in keys if keys.count(key) > 1}:
            raise InputError(f"--set names {min(twice)} twice: name it once.")
        try:
            return cls.model_validate({key: value for key, _, value in pairs})
        except ValidationError as error:
            first = error.errors()[0]
            raise InputError(
                f"--set {first['loc'][0]}={first['input']} cannot be used: {first['msg'].lower()}."
            ) from error

    def words(self) -> list[str]:
        """Return what `of` was given."""
        overrides = self.model_dump(exclude_none=True)
        return [
            f"{key}={value if isinstance(value, str) else format(value, '.10g')}"
            for key, value in overrides.items()
        ]

    def subset(self, dataset: "Dataset") -> "Dataset":
        """The training views and exposures of a data set that are used; held-out views stay as they are."""
        train = dataset.train if self.views is None else _evenly(dataset.train, self.views)
        return replace(dataset, train=tuple(map(self.bracket, train)))

    def bracket(self, view: "View") -> "View":
        """A training view with those of its exposures that are used."""
        if self.exposures is None:
            return view
        return replace(view, shots=_of_each_band(view.shots, self.exposures))

    def composed(self, method: "Method") -> "Method":
        """A method with the loss and the harmonics that are set."""
        if self.ssim is not None:
            method = replace(method, loss=replace(method.loss, ssim_weight=self.ssim))
        if self.degree is not None:
            method = replace(method, degrees=method.degrees[: self.degree])
        return method


def _of_each_band(shots: tuple["Shot", ...], count: int) -> tuple["Shot", ...]:
    """`count` of the shots of each band, in their order."""
    places: dict[int | None, list[int]] = {}
    for place, shot in enumerate(shots):
        places.setdefault(shot.band, []).append(place)
    chosen = [place for band in places.values() for place in _evenly(tuple(band), count)]
    return tuple(shots[place] for place in sorted(chosen))


def _evenly(items: tuple[T, ...], count: int) -> tuple[T, ...]:
    """`count` of them from the first to the last; the middle one if it is one."""
    if count >= len(items):
        return items
    if count == 1:
        return (items[len(items) // 2],)
    return tuple(items[place] for place in np.rint(np.linspace(0, len(items) - 1, count)).astype(int))
