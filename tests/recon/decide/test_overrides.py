"""Settings by hand: what is read, what is refused, and that a training does as it is told."""

from dataclasses import replace
from typing import get_args

import pytest

from imaging.errors import InputError
from recon import reconstruct as stage
from recon.decide.overrides import Overrides
from recon.decide.presets import OVERRIDES, QUALITIES, MethodName, Quality
from recon.decide.request import TrainingRequest
from recon.methods import METHODS
from recon.result.opened import open_model
from recon.trade.sweep_order import Session


def test_the_names_that_help_shows_are_those_that_there_are() -> None:
    assert tuple(Overrides.model_fields) == OVERRIDES
    assert set(get_args(MethodName)) == {"auto", *METHODS}


def test_words_are_read_and_said_again() -> None:
    words = ["iterations=500", "ssim=0.2", "growth=0", "exposures=2"]
    overrides = Overrides.of(words)
    assert (overrides.iterations, overrides.ssim, overrides.growth, overrides.gaussians) == (
        500,
        0.2,
        0,
        None,
    )
    assert Overrides.of(overrides.words()) == overrides
    assert sorted(overrides.words()) == sorted(words)


def test_large_numbers_keep_their_digits() -> None:
    overrides = Overrides(gaussians=12_345_678)
    assert Overrides.of(overrides.words()) == overrides


@pytest.mark.parametrize(
    "words",
    [
        ["magic=1"],
        ["iterations"],
        ["iterations="],
        ["iterations=0"],
        ["iterations=many"],
        ["iterations=1.5"],
        ["degree=3"],
        ["ssim=nan"],
        ["growth=1"],
        ["views=2", "views=3"],
        [""],
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(words: list[str]) -> None:
    with pytest.raises(InputError, match=r"--set .*: .*\.$|--set .*cannot be used: .*\.$"):
        Overrides.of(words)


@pytest.mark.parametrize(
    ("count", "stops"), [(1, [3]), (2, [0, 6]), (3, [0, 3, 6]), (4, [0, 2, 4, 6]), (99, list(range(7)))]
)
def test_exposures_are_taken_evenly(toy_dataset, count: int, stops: list[int]) -> None:
    view = toy_dataset.train[0]
    seven = replace(view, shots=tuple(replace(view.shots[0], k=2.0**k) for k in range(7)))
    held_out = toy_dataset.held_out
    subset = Overrides(exposures=count).subset(replace(toy_dataset, train=(seven,)))
    assert [shot.k for shot in subset.train[0].shots] == [2.0**k for k in stops]
    assert subset.held_out is held_out


def test_exposures_are_taken_of_each_band(toy_dataset) -> None:
    view = toy_dataset.train[0]
    taken = [(band, k) for k in (1.0, 2.0, 4.0) for band in (0, 2, 1)] + [(3, 1.0)]
    wheel = replace(view, shots=tuple(replace(view.shots[0], band=band, k=k) for band, k in taken))
    dataset = replace(toy_dataset, train=(wheel,))
    assert Session.of(dataset).exposures == 3
    for count, ks in ((1, (2.0,)), (2, (1.0, 4.0)), (3, (1.0, 2.0, 4.0))):
        shots = Overrides(exposures=count).subset(dataset).train[0].shots
        wanted = [(band, k) for band, k in taken if k in ks or band == 3]
        assert [(shot.band, shot.k) for shot in shots] == wanted


def test_views_are_taken_evenly(toy_dataset) -> None:
    subset = Overrides(views=3).subset(toy_dataset)
    names = [view.name for view in toy_dataset.train]
    assert [view.name for view in subset.train] == [names[0], names[len(names) // 2], names[-1]]


def test_a_training_is_as_it_was_told(session_copy, monkeypatch: pytest.MonkeyPatch) -> None:
    """And is found again, with all of it, when the scene is opened; other settings train anew."""
    monkeypatch.setitem(QUALITIES, "draft", Quality(20, 400, 320))
    overrides = Overrides(
        iterations=12, gaussians=200, width=32, degree=1, ssim=0.5, growth=0, views=3, exposures=1
    )
    folder = stage.reconstruct(
        session_copy, TrainingRequest(quality="draft", overrides=overrides, name="by-hand")
    )
    opened = open_model(folder)
    assert opened.record.settings.overrides == overrides
    assert opened.training.iteration == 12
    assert len(opened.training.gaussians) <= 200
    assert {view.lens.width for view in opened.dataset.views} == {32}
    assert opened.training.method.degree(1.0) == 1
    assert opened.training.method.loss.ssim_weight == 0.5
    assert len(opened.dataset.train) == 3
    assert {len(view.shots) for view in opened.dataset.train} == {1}
    assert min(len(view.shots) for view in opened.dataset.held_out) > 1
    stamp = (folder / "splats.ply").stat().st_mtime_ns
    assert (
        stage.reconstruct(session_copy, TrainingRequest(quality="draft", overrides=overrides, name="by-hand"))
        == folder
    )
    assert (folder / "splats.ply").stat().st_mtime_ns == stamp
    stage.reconstruct(
        session_copy,
        TrainingRequest(quality="draft", overrides=Overrides(iterations=13), name="by-hand", replace=True),
    )
    assert open_model(folder).training.iteration == 13
