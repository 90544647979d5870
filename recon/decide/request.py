"""Options that a user gives a training."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

from imaging.errors import InputError
from imaging.request import Request
from recon.decide.presets import QUALITIES, MethodName, QualityName

if TYPE_CHECKING:
    from recon.decide.cost.budget import Budget
    from recon.decide.overrides import Overrides

LARGEST_SEED = 2**32 - 1
_PRESETS = "; ".join(
    f"{name}: {preset.iterations:,} iterations or {preset.looks} per training view, at most "
    f"{preset.gaussians:,} Gaussians or {preset.each:,} per view, {preset.width} px wide"
    for name, preset in QUALITIES.items()
)


def _none_set() -> "Overrides":
    from recon.decide.overrides import Overrides  # which takes numpy and pydantic

    return Overrides()


@dataclass(frozen=True)
class TrainingRequest(Request):
    """Options of a training: the command line, Python, a batch and the benches each make one.

    Raises:
        InputError: The seed is out of range, or the name is not that of a folder.
    """

    method: Annotated[
        MethodName,
        "auto chooses by the files of the session: nh-3dgs for RAW and EXR, hdr-gs for photographs with "
        "different exposures, else vanilla, with the Gaussians and colours of standard 3DGS.",
    ] = "auto"
    quality: Annotated[QualityName, f"Preset of training length and resolution: {_PRESETS}."] = "standard"
    budget: Annotated[
        "Budget | None",
        "Finish in 90s or 5m, from Enter to the report (skipped if time is short, in this order: the "
        "report, depths of some views, model trials); make splats.ply no larger than 30MB; use at most 100k "
        "Gaussians; or stop when held-out views reach 35dB.",
    ] = None
    seed: Annotated[int, "The same seed gives the same bytes."] = 0
    overrides: Annotated["Overrides", "Override settings of the preset and the method."] = field(
        default_factory=_none_set
    )
    early_stop: Annotated[
        bool,
        "Stop where trainings usually stop improving, or earlier, when the validation views (up to half of "
        "the held-out ones) do.",
    ] = False
    all_views: Annotated[
        bool,
        "Train on every view, also on the one in eight that is otherwise held out. Nothing can then be "
        "measured: train without it first, and use this for the scene that you show.",
    ] = False
    name: Annotated[
        str | None,
        "Folder name under SESSION/reconstructions; if not given, method, quality and budget, such as "
        "nh-3dgs-standard, with -all if no view is held out.",
    ] = None
    replace: Annotated[
        bool, "Train again and replace the scene of that name once the new one is finished."
    ] = False

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= LARGEST_SEED:
            raise InputError(f"The seed {self.seed} is out of range: give a number from 0 to {LARGEST_SEED}.")
        if self.all_views and self.budget is not None and self.budget.unit == "dB":
            raise InputError(
                "A budget in dB is judged by held-out views, and --all-views leaves none: give a time, or "
                "leave out one of the two."
            )
        name = self.name
        if name is not None and (not name or name.startswith(".") or {"/", "\\"} & set(name)):
            raise InputError(
                f"The name {name!r} is not that of a folder: give one without slashes that does not begin "
                "with a dot."
            )

    def most_gaussians(self, views: int, pixels: int, degree: int = 0) -> int:
        """Maximum number of Gaussians: of the budget, else of an override, else of the preset.

        Args:
            views: Number of training views.
            pixels: Of all of them together.
            degree: Of the harmonics; a budget in bytes holds fewer Gaussians of a higher one.

        Returns:
            The number before anything is decided by the scene.
        """
        budget = None if self.budget is None else self.budget.gaussians_of(degree)
        if budget is not None:
            return min(budget, pixels)  # more Gaussians than pixels cannot be distinguished
        return self.overrides.gaussians or QUALITIES[self.quality].gaussians_of(views)
