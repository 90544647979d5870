"""How long and how fine a training is when nothing else is asked for."""

from dataclasses import dataclass
from typing import Literal

QualityName = Literal["draft", "standard", "best"]


@dataclass(frozen=True)
class Quality:
    """A preset: how long, how many at most, how fine. bench/recon/presets.py has the fronts behind it."""

    iterations: int
    gaussians: int
    width: int


QUALITIES: dict[str, Quality] = {
    "draft": Quality(300, 20_000, 320),
    "standard": Quality(2000, 40_000, 640),
    "best": Quality(4000, 80_000, 1280),
}

START_SHARE = 0.5
"""Share of the largest number of Gaussians that training starts with; the rest grows where it is wrong."""
