"""Corrections that a training may make: by known errors, else by a trial."""

from dataclasses import replace

import numpy as np
import pytest

from imaging.errors import InputError
from imaging.progress import unreported
from imaging.session.calibration import PoseError
from imaging.session.records import Rung
from recon.data.load import load
from recon.decide.evidence import Evidence
from recon.decide.overrides import Overrides
from recon.decide.steps.corrections import (
    corrections_for,
    pose_error_px,
    require_light,
    rungs_by_evidence,
    tried,
)
from recon.decide.trials import reason_against_trials

from ..runs import run_of, settings


def rungs_of(dataset, wanted):
    """Rungs of the decision without a time limit."""
    return rungs_by_evidence(dataset, wanted, reason_against_trials(dataset, wanted), unreported)


def test_most_rungs_are_decided_without_a_trial(toy_long, toy_dataset):
    assert all("5 training views are too few" in rung.reason for rung in rungs_of(toy_dataset, settings()))
    assert all("draft" in rung.reason for rung in rungs_of(toy_long, settings(quality="draft")))
    without = rungs_by_evidence(toy_long, settings(), "for want of time", unreported)
    assert [(rung.taken, rung.reason) for rung in without] == [(False, "for want of time")] * 3


def test_a_calibration_that_is_sure_of_itself_needs_no_trial(toy_long):
    focal = toy_long.train[0].lens.fx
    error = PoseError(rotation=float(np.degrees(0.05 / focal)), translation=0.0)
    views = [view.model_copy(update={"error": error}) for view in toy_long.calibration.views]
    rungs = (
        _rung("exposure_ratios", 4.0, 0.1),
        _rung("exposure_per_shot", 0.2, None, taken=False),
        _rung("vignetting", 0.5, 0.1),
    )
    sure = replace(
        toy_long, calibration=toy_long.calibration.model_copy(update={"views": views, "rungs": rungs})
    )
    assert pose_error_px(sure) == pytest.approx(0.05, rel=0.05)
    judged = rungs_of(sure, settings())
    assert [rung.taken for rung in judged] == [False] * 3
    assert "0.05 px" in judged[0].reason
    assert "0.2 %" in judged[1].reason


@pytest.mark.parametrize(
    ("judged", "known"), [(True, "determine their ratios to 0.5 %"), (False, "are too few")]
)
def test_exposures_of_photographs_are_as_sure_as_their_curve(toy_ldr, judged, known):
    """3 % between exposures is noise, where the calibration has asked for other exposures in vain."""
    dataset = load(toy_ldr)

    def measured(view):
        response = view.sensor.response
        sigma = tuple((0.005,) * len(response.codes) for _ in range(3))
        response = response.model_copy(update={"residual": 0.03, "sigma": sigma, "valid": (0.02, 0.98)})
        return replace(view, sensor=replace(view.sensor, response=response))

    labels = _rung("exposure_labels", 1e-4 if judged else None, 1e-4, taken=False)
    calibration = dataset.calibration.model_copy(update={"rungs": (labels,)})
    sure = replace(dataset, train=tuple(map(measured, dataset.train)), calibration=calibration)
    rung = rungs_of(sure, settings(method="hdr-gs"))[1]
    assert known in rung.reason
    assert not rung.taken


def test_display_values_are_not_corrected_as_light(toy_ldr):
    dataset, overrides = load(toy_ldr), Overrides(refine="poses+exposures+glare")
    with pytest.raises(InputError, match=r"no exposures .* hdr-gs, or leave exposures and glare out"):
        require_light(dataset, "vanilla", overrides)
    for method in ("auto", "hdr-gs"):
        require_light(dataset, method, overrides)
    require_light(dataset, "vanilla", Overrides(refine="poses"))
    chosen = settings(method="vanilla", overrides=overrides)
    run = run_of(dataset, chosen)
    corrections = corrections_for(run, Evidence.of(run), chosen, None)
    assert corrections.names == ("poses",)
    assert "display values are taken as they are" in corrections.rungs[1].reason
    assert corrections.rungs[2].reason == "not asked for"


def test_a_trial_is_judged_on_views_of_its_own(toy_long, monkeypatch):
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_LOOKS", 2)
    monkeypatch.setattr("recon.decide.steps.corrections.TRIAL_GAUSSIANS", 200)
    monkeypatch.setattr("recon.decide.held_out_evidence.STEPS", 4)
    rung = tried(toy_long, ["poses"], settings(), unreported)["poses"]
    assert rung.name == "refine poses"
    assert rung.gain is not None
    assert rung.standard_error is not None
    assert rung.taken == (rung.gain > 2 * rung.standard_error)
    assert "20 iterations, judged on 4 views" in rung.reason


def _rung(name, gain, error, taken=True):
    return Rung(name=name, taken=taken, gain=gain, standard_error=error, reason="measured")
