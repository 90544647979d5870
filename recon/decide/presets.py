"""Named choices of a training: methods, presets, and the settings that `--set` overrides.

Nothing heavy is imported, so that the help of a command can show it.
"""

from dataclasses import dataclass
from typing import Literal, get_args

TrainedMethod = Literal["nh-3dgs", "hdr-gs", "vanilla"]
"""The methods of `recon.methods.METHODS`."""
MethodName = Literal["auto", TrainedMethod]
"""auto: by what the session holds (`recon.decide.steps.method_choice`)."""
QualityName = Literal["draft", "standard", "best"]
"""The smallest first."""
OVERRIDES = (
    "iterations", "gaussians", "width", "degree", "ssim", "growth", "views", "exposures", "refine",
    "environment", "depth", "overrule",
)  # fmt: skip
"""The keys of `--set`: the fields of `recon.decide.overrides.Overrides`."""


@dataclass(frozen=True)
class Quality:
    """Preset: iterations, maximum number of Gaussians, resolution. bench/recon/presets.py has the fronts
    behind it.

    looks: iterations for each training view, where those of the preset are fewer. each: Gaussians likewise.
    Lego (100 views of 200 px, 2,500 iterations) has 31.5 dB over white with 40,000 Gaussians and 32.2 with
    100,000.
    """

    iterations: int
    gaussians: int
    width: int
    looks: int = 0
    each: int = 0

    def iterations_of(self, views: int) -> int:
        """Return the iterations for that many training views: each has to be seen often enough."""
        return max(self.iterations, self.looks * views)

    def gaussians_of(self, views: int) -> int:
        """Maximum number of Gaussians for that many training views: they show more of the scene."""
        return max(self.gaussians, self.each * views)


QUALITIES: dict[str, Quality] = {
    "draft": Quality(300, 20_000, 320, looks=10, each=200),
    "standard": Quality(2000, 40_000, 640, looks=40, each=500),
    "best": Quality(4000, 80_000, 1280, looks=100, each=1500),
}


def downwards(quality: QualityName) -> tuple[QualityName, ...]:
    """A preset and those that are smaller, the smallest last: what a time may fall back on."""
    names = get_args(QualityName)
    return tuple(reversed(names[: names.index(quality) + 1]))


START_SHARE = 0.5
"""Share of the largest number of Gaussians that training starts with; the rest grows where it is wrong."""
