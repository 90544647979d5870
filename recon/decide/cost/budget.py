"""Budget of a training: time, size, Gaussians or quality, in one word."""

import math
import re
from dataclasses import dataclass
from typing import Literal

from imaging.errors import InputError
from recon.scene.ply import most_gaussians

Unit = Literal["s", "bytes", "Gaussians", "dB"]

_FACTORS: dict[str, tuple[float, Unit]] = {
    "": (1, "s"),
    "s": (1, "s"),
    "m": (60, "s"),
    "h": (3600, "s"),
    "KB": (1e3, "bytes"),
    "MB": (1e6, "bytes"),
    "GB": (1e9, "bytes"),
    "k": (1e3, "Gaussians"),
    "dB": (1, "dB"),
}
HOW = "write a time as 90s, 5m or 1h, a size as 300MB or 2GB, Gaussians as 100k, or a quality as 35dB"
FEWEST_GAUSSIANS = 100
BEST_DB = 100.0


@dataclass(frozen=True)
class Budget:
    """An amount of one kind.

    s: the training ends within it. bytes: splats.ply is no larger. Gaussians: there are no more. dB:
    the training ends when held-out views are this good.
    """

    amount: float
    unit: Unit

    def __post_init__(self) -> None:
        if self.unit == "s" and not 0 < self.amount < math.inf:
            raise InputError(
                f"A budget of {self.amount:g} s is too short for training: give one such as 90s or 5m."
            )
        if self.unit == "dB" and not 0 < self.amount < BEST_DB:
            raise InputError(f"A quality of {self.amount:g} dB is out of range: give one such as 35dB.")
        cap = self.gaussians
        if cap is not None and cap < FEWEST_GAUSSIANS:
            raise InputError(f"A budget of {self} is too small for a scene: give one such as 20k or 3MB.")

    @classmethod
    def parse(cls, text: str) -> "Budget":
        """`90s`, `1.5m`, `1h`, `300MB`, `2GB`, `100k` or `35dB`; InputError otherwise.

        A number alone is seconds. Letters are read as they are written: m is minutes, MB megabytes.
        """
        match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([A-Za-z]*)\s*", text)
        if match is None or match[2] not in _FACTORS:
            raise InputError(f"A budget of {text.strip()!r} is not understood: {HOW}.")
        factor, unit = _FACTORS[match[2]]
        return cls(float(match[1]) * factor, unit)

    @classmethod
    def of(cls, amount: "Budget | float | str | None") -> "Budget | None":
        """Return the budget that text states, as in `parse`, or that so long a time is, in seconds."""
        if amount is None or isinstance(amount, Budget):
            return amount
        return cls.parse(amount) if isinstance(amount, str) else cls(amount, "s")

    @property
    def gaussians(self) -> int | None:
        """The most Gaussians that fit, of whichever degree, for those kinds that limit them."""
        return self.gaussians_of(0)

    def gaussians_of(self, degree: int) -> int | None:
        """The most Gaussians of that degree that fit, for those kinds that limit them."""
        if self.unit == "bytes":
            return most_gaussians(self.amount, degree)
        return int(self.amount) if self.unit == "Gaussians" else None

    def __str__(self) -> str:
        """Format as on the command line."""
        if self.unit == "bytes":
            power = 9 if self.amount >= 1e9 else 6 if self.amount >= 1e6 else 3
            return f"{self.amount / 10**power:g}{ {9: 'GB', 6: 'MB', 3: 'KB'}[power] }"
        if self.unit == "Gaussians":
            return f"{self.amount / 1000:g}k"
        return f"{self.amount:g}{self.unit}"
