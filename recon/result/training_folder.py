"""Folder of a training, chosen so that no scene is lost by training another."""

from pathlib import Path

from imaging.errors import InputError
from imaging.record import parse
from recon.data.dataset import Dataset
from recon.decide.cost.budget import Budget
from recon.decide.request import TrainingRequest
from recon.decide.settings import Settings
from recon.methods import METHODS
from recon.result.model import CHECKPOINT, MODEL
from recon.scene.checkpoint import Checkpoint, read_checkpoint


def default_name(method: str, quality: str, budget: Budget | None, *, all_views: bool = False) -> str:
    """Default name of a scene: `nh-3dgs-standard`, `nh-3dgs-standard-300s` or `nh-3dgs-standard-all`."""
    parts = [method, quality, *([] if budget is None else [str(budget)]), *(["all"] if all_views else [])]
    return "-".join(parts)


def names_of(request: TrainingRequest) -> tuple[str, ...]:
    """Names that the scene of a request may get: one, or one of each method where the files decide on it."""
    if request.name:
        return (request.name,)
    methods = tuple(METHODS) if request.method == "auto" else (request.method,)
    return tuple(
        default_name(method, request.quality, request.budget, all_views=request.all_views)
        for method in methods
    )


def place_for(
    folder: Path, wanted: Settings, dataset: Dataset, replace: bool
) -> tuple[Path, Checkpoint | None]:
    """The folder to train in, and the training of just these settings to go on with, if it is there.

    Args:
        folder: Of the scene.
        wanted: Settings as requested.
        dataset: Views to train on and to hold out: a training to go on with has to be of the same
            photographs, masks and calibration, and of the same depth maps unless `wanted` leaves them out.
        replace: True if what the folder holds is to be replaced in the end.

    Returns:
        The folder, which is another one than `folder`, beside it, where what that holds is to be replaced;
        and the checkpoint, None to begin anew.

    Raises:
        InputError: The folder holds another training and is not to be replaced.
    """
    taken = (folder / CHECKPOINT).is_file() or (folder / MODEL).is_file()
    place = folder.with_name(f".{folder.name}.new") if taken and replace else folder
    path = place / CHECKPOINT
    checkpoint = read_checkpoint(path) if path.is_file() else None
    inputs = {
        "asked": wanted.model_dump(mode="json"),
        "calibration_sha256": dataset.calibration_sha256,
        "photographs_sha256": dataset.photographs_sha256,
    }
    if wanted.overrides.depth != 0:
        inputs["depths_sha256"] = dataset.depths_sha256
    # A checkpoint of before depth maps had a hash counts as one without any.
    if checkpoint is not None and inputs.items() <= {"depths_sha256": "", **checkpoint.facts}.items():
        return place, checkpoint
    if taken and not replace:
        raise InputError(
            f"{folder} exists already, {_difference(path, checkpoint, wanted, dataset)}: give this training "
            "another --name, or --replace that one."
        )
    return place, None


def _difference(path: Path, checkpoint: Checkpoint | None, wanted: Settings, dataset: Dataset) -> str:
    """Return how a training differs from what is wanted, in words."""
    if checkpoint is None:
        return "without the checkpoint that has its settings"
    there, asked = parse(Settings, checkpoint.facts["asked"], path).words(), wanted.words()
    other = [f"{key} {value}" for key, value in there.items() if value != asked[key]]
    if other:
        return f"trained with {', '.join(other)}"
    if checkpoint.facts["calibration_sha256"] != dataset.calibration_sha256:
        return "trained on an earlier calibration, or with another rig"
    if checkpoint.facts.get("photographs_sha256") != dataset.photographs_sha256:
        return "trained on other photographs or masks"
    if checkpoint.facts["asked"] != wanted.model_dump(mode="json"):
        return "trained by another version of rig"
    return "trained on other depth maps"
