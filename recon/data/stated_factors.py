"""A data set with the factors of photographs that scene points ask for against what their files state."""

from collections.abc import Collection
from dataclasses import replace
from typing import get_args

from imaging.session.calibration import StatedPart
from imaging.session.session import Session
from recon.data.dataset import Dataset, View

PARTS: tuple[StatedPart, ...] = get_args(StatedPart)


def asked_parts(dataset: Dataset) -> tuple[StatedPart, ...]:
    """The parts of which scene points ask for factors of training views, against the files."""
    train = {view.id for view in dataset.train}
    asking = [view for view in dataset.calibration.views if view.id in train]
    asked = {
        "exposure": any(view.exposure_asked is not None for view in asking),
        "white_balance": any(view.white_balance_asked is not None for view in asking),
    }
    return tuple(part for part in PARTS if asked[part])


def overruled(dataset: Dataset, parts: Collection[StatedPart]) -> Dataset:
    """The data set with the factors of these parts in its calibration and in its views."""
    if not parts:
        return dataset
    before = dataset.calibration
    views = tuple(view.overruled(parts) for view in before.views)
    factor = {new.id: new.exposure / old.exposure for new, old in zip(views, before.views, strict=True)}
    white = {view.id: view.white_balance for view in views}
    scale = dict(before.exposure_scale)
    for shot in Session.open(dataset.session).shots():
        if shot.file in scale:
            scale[shot.file] *= factor.get(shot.view, 1.0)

    def applied(view: View) -> View:
        shots = tuple(replace(shot, k=shot.k * factor[view.id]) for shot in view.shots)
        return replace(view, shots=shots, sensor=replace(view.sensor, white_balance=white[view.id]))

    return replace(
        dataset,
        train=tuple(map(applied, dataset.train)),
        held_out=tuple(map(applied, dataset.held_out)),
        calibration=before.model_copy(update={"views": views, "exposure_scale": scale}),
        overruled=(*dataset.overruled, *parts),
    )
