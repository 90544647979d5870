"""What files state as constant is overruled where light did vary, and nowhere else."""

import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imaging.arrays import Array
from imaging.progress import Progress, unreported
from imaging.session.records import Rung
from recon.data.dataset import Dataset, View
from recon.data.load import again, load
from recon.data.stated_factors import asked_parts
from recon.decide import decisions
from recon.decide.decisions import with_light_of_photographs
from recon.decide.evidence import Evidence, Run
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.decide.steps import stated_settings
from recon.decide.steps.stated_settings import overruled_parts, tried
from recon.reconstruct import reconstruct
from recon.result.model import SPLATS, read_model
from recon.result.opened import open_model
from tests.conftest import MadeOnce

from ..runs import run_of, settings
from .light_of_photographs import drawn, session_lit_by

VARIED = drawn(0.35, 0.25)
BOTH = ("exposure", "white_balance")


@pytest.fixture(scope="session")
def varied(made_once: MadeOnce) -> Path:
    """Photographs whose light varied, with the true factors kept beside what files state."""
    return made_once("recon-lit-varied", lambda folder: session_lit_by(folder, VARIED, VARIED))


@pytest.fixture(scope="session")
def constant(made_once: MadeOnce) -> Path:
    """Photographs whose light did not vary, though points ask for factors of 5 % of it."""
    return made_once(
        "recon-lit-alike", lambda folder: session_lit_by(folder, np.ones_like(VARIED), drawn(0.05, 0.05))
    )


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stated_settings, "TRIAL_LOOKS", 8)


@pytest.fixture
def short_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains of views that judge are fitted in fewer steps, which otherwise take longer than the trials."""
    monkeypatch.setattr("recon.decide.held_out_evidence.STEPS", 12)


@pytest.fixture
def no_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*arguments: object) -> None:
        raise AssertionError("a trial was made")

    monkeypatch.setattr(stated_settings, "tried", refused)


def light_of(view: View) -> Array:
    """Factors that a view's photograph is taken as developed with."""
    return view.shots[0].k * np.array(view.sensor.white_balance)


def off(dataset: Dataset, stated: Dataset) -> float:
    """Largest error of the factors by which the views differ from what the files state, natural log."""
    pairs = zip(dataset.views, stated.views, strict=True)
    errors = [
        np.log(light_of(view) / light_of(before) / VARIED[view.frame, int(view.camera[3:])])
        for view, before in pairs
    ]
    return float(np.abs(errors).max())


@pytest.mark.usefixtures("short", "short_fits")
@pytest.mark.parametrize("method", ["vanilla", "hdr-gs"])
def test_light_that_varied_overrules_the_files(varied: Path, method: str) -> None:
    dataset, said = load(varied), list[str]()
    run = run_of(dataset, settings(method=method), said=said)
    decided, evidence, rungs = with_light_of_photographs(run, Evidence.of(run))
    assert [rung.taken for rung in rungs] == [True, True]
    assert decided.asked.overruled == BOTH
    for taken in (decided.dataset, evidence.dataset, again(evidence.dataset, 32, unreported)):
        assert off(taken, dataset) < 1e-6
    sizes = [np.log(VARIED).mean(axis=2).std(), (np.log(VARIED) - np.log(VARIED).mean(2)[..., None]).std()]
    for line, part, size in zip(said, ("exposure", "white balance"), sizes, strict=True):
        assert line.startswith(f"the {part} that the files state as the same for all photographs differs by ")
        assert float(line.split("differs by ")[1].split(" %")[0]) == pytest.approx(100 * size, rel=0.15)


@pytest.mark.usefixtures("short", "short_fits")
def test_light_that_was_constant_stays_so(constant: Path) -> None:
    dataset, said = load(constant), list[str]()
    run = run_of(dataset, settings(method="vanilla"), said=said)
    decided, evidence, rungs = with_light_of_photographs(run, Evidence.of(run))
    assert [(rung.taken, rung.gain is not None) for rung in rungs] == [(False, True)] * 2
    assert (decided.dataset, decided.asked, said) == (dataset, run.asked, [])
    assert evidence.dataset.overruled == ()


@pytest.mark.usefixtures("short")
def test_factors_of_other_photographs_are_refused(varied: Path) -> None:
    """Light did vary, but otherwise: each photograph is given the factor of another."""
    dataset = load(varied)
    views = dataset.calibration.views
    turned = [
        view.model_copy(update={"exposure_asked": other.exposure_asked, "white_balance_asked": None})
        for view, other in zip(views, (*views[5:], *views[:5]), strict=True)
    ]
    record = dataset.calibration.model_copy(update={"views": tuple(turned)})
    mistaken = replace(dataset, calibration=record)
    assert asked_parts(mistaken) == ("exposure",)
    # As wide as the photographs: a trial at another width reads the calibration again.
    wanted = settings(method="vanilla", max_width=64)
    assert not tried(mistaken, ["exposure"], wanted, unreported)["exposure"].taken


@pytest.mark.usefixtures("no_trial")
def test_no_trial_is_made_where_nothing_asks_for_it(toy_long: Dataset) -> None:
    run = run_of(toy_long, settings())
    evidence = Evidence.of(run)
    assert with_light_of_photographs(run, evidence) == (run, evidence, ())


@pytest.mark.usefixtures("no_trial")
def test_nor_where_it_is_refused_asked_for_or_has_no_time(varied: Path) -> None:
    dataset = load(varied)

    evidence = Evidence.of(run_of(dataset, settings()))

    def parts(against: str | None = None, **overrides: str) -> tuple[tuple[str, ...], list[str]]:
        wanted = settings(overrides=Overrides(**overrides))
        run = run_of(dataset, wanted)
        taken, rungs = overruled_parts(run, evidence, against)
        return taken, [rung.reason for rung in rungs]

    assert parts(overrule="none") == ((), ["left out, as asked for"] * 2)
    assert parts(overrule="white_balance+exposure") == (BOTH, ["asked for"] * 2)
    assert parts(overrule="exposure") == (("exposure",), ["asked for", "left out, as asked for"])
    assert parts("for want of time") == ((), ["for want of time"] * 2)
    run = run_of(dataset, settings(quality="draft"))
    _, _, rungs = with_light_of_photographs(run, Evidence.of(run))
    assert ["draft" in rung.reason for rung in rungs] == [True, True]


def test_a_training_that_goes_on_keeps_the_decision(
    varied: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decided = list[object]()

    def by_trial(run: Run, *arguments: object) -> tuple[tuple[str, ...], tuple[Rung, ...]]:
        decided.append(run.dataset)
        return BOTH, tuple(Rung(name=part, taken=True, reason="by a trial") for part in BOTH)

    def interrupt(message: str, done: int, total: int) -> None:
        if "loss" in message and done < total:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(decisions, "overruled_parts", by_trial)
    session = shutil.copytree(varied, tmp_path / "S")
    chosen = Overrides(iterations=60, gaussians=200, refine="none", environment=False, degree=0)

    def trained(name: str, on_progress: Progress = unreported) -> Path:
        request = TrainingRequest(method="vanilla", overrides=chosen, name=name)
        return reconstruct(session, request, on_progress=on_progress)

    whole = trained("whole")
    with pytest.raises(KeyboardInterrupt):
        trained("twice", interrupt)
    assert len(decided) == 2
    twice = trained("twice")
    assert len(decided) == 2
    assert read_model(twice).settings.overruled == BOTH
    assert (twice / SPLATS).read_bytes() == (whole / SPLATS).read_bytes()
    assert off(open_model(twice).dataset, load(varied)) < 1e-6
