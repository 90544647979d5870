"""Trainings that are cut short: by the clock, since quality stands still, or since it is reached."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import torch

import recon.reconstruct as stage
from imaging.errors import ReconstructionError
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.methods import METHODS
from recon.result.model import read_model
from recon.scene.checkpoint import read_checkpoint, write_checkpoint
from recon.train import half_size, live_curve
from recon.train.densification import DensityRules
from recon.train.early_stopping import COOL_DOWN, Deadline, EarlyStop, Goal
from recon.train.live_curve import Moment, chosen_views, period
from recon.train.monitor import Hooks
from recon.train.schedule import Schedule
from recon.train.trainer import train
from recon.train.training import Plan, Training
from recon.train.training_checkpoint import checkpoint_of, light_in, restored
from tests.recon.beginning import beginning

CAP = 300


@pytest.fixture(scope="module")
def begun(toy_dataset):
    """A function that makes a new small training on the toy session, always the same."""
    return beginning(toy_dataset, 150)


class Clock:
    """Stands still, but for what each iteration is said to cost."""

    def __init__(self, cost) -> None:
        self.now, self.cost = 1000.0, cost

    def __call__(self) -> float:
        return self.now

    def tick(self, training):
        """A steer that wants nothing."""
        self.now += self.cost(training)
        return None


def run(training, dataset, iterations, steers=(), clock=None, until=None, seed=0):
    plan = Plan(iterations, DensityRules(CAP), seed=seed, log_every=1000, measure=True)
    lines = []
    timed = {} if clock is None else {"clock": clock}
    train(training, dataset, plan, Hooks(log=lines.append, steers=steers, **timed), until=until)
    return lines


def assert_same(first: Training, second: Training) -> None:
    one, two = (checkpoint_of(training, {}).tensors for training in (first, second))
    assert set(one) == set(two)
    for name, value in one.items():
        assert torch.equal(value, two[name]), name


@pytest.mark.parametrize(
    ("cost", "planned"),
    [
        pytest.param(lambda t: 0.01, 100, id="as planned"),
        pytest.param(lambda t: 0.016, 100, id="slower than the probe"),
        pytest.param(lambda t: 0.006, 100, id="faster than the probe"),
        pytest.param(lambda t: 0.01 if t.iteration < 45 else 0.03, 100, id="load from the middle on"),
        pytest.param(lambda t: 0.02 if 20 < t.iteration < 40 else 0.008, 100, id="load for a while"),
        pytest.param(lambda t: 0.01 * len(t.gaussians) / CAP, 100, id="growing with the Gaussians"),
    ],
)
def test_a_time_is_kept_whatever_the_machine_does(begun, toy_dataset, cost, planned):
    """One second, planned as 100 iterations of 10 ms; the schedule always comes to its end."""
    training, clock = begun(), Clock(cost)
    run(training, toy_dataset, planned, [clock.tick, Deadline(1.0, 1000, CAP)], clock)
    assert 0.9 <= clock.now - 1000 <= 1.05
    assert training.seconds + training.measuring <= 1.0
    assert training.iteration == training.schedule.total
    assert training.schedule.progress(training.iteration) == 1
    assert training.optimizer.param_groups[0]["lr"] < 2 * training.optimizer.param_groups[0]["rate"].end


def test_views_that_come_to_full_size_keep_the_time(begun, toy_dataset):
    """Iterations of the second half take four times as long; the first ones are no reason to plan more."""
    half = Clock(lambda t: 0.004 if t.schedule.progress(t.iteration) < 0.5 else 0.016)
    training, clock = begun(), half
    run(training, toy_dataset, 100, [clock.tick, Deadline(1.0, 1000, CAP, slowdown=4.0)], clock)
    assert 0.9 <= clock.now - 1000 <= 1.05
    assert training.schedule.total <= 105


def test_a_schedule_that_turns_makes_no_progress_jump(begun, toy_dataset):
    """Require growing progress, of a length that stays, though its iterations change at each turn."""
    training, clock, reports = begun(), Clock(lambda t: 0.01 if t.iteration < 45 else 0.03), []
    train(
        training,
        toy_dataset,
        Plan(100, DensityRules(CAP), log_every=5, measure=True),
        Hooks(
            progress=lambda message, done, total: reports.append((done, total)),
            steers=[clock.tick, Deadline(1.0, 1000, CAP)],
            clock=clock,
        ),
    )
    assert len(training.schedule.turns) > 2
    assert training.iteration < 100
    done = [place for place, _ in reports]
    assert done == sorted(done)
    assert max(np.diff(done)) < 40
    assert {total for _, total in reports} == {100}
    assert done[-1] == 100


def test_a_machine_that_stands_still_ends_the_training_at_once(begun, toy_dataset):
    training, clock = begun(), Clock(lambda t: 0.01 if t.iteration != 50 else 3.0)
    run(training, toy_dataset, 100, [clock.tick, Deadline(1.0, 1000, CAP)], clock)
    assert training.iteration <= 53


def test_time_to_spare_does_not_make_a_preset_longer(begun, toy_dataset):
    training, clock = begun(), Clock(lambda t: 0.001)
    run(training, toy_dataset, 40, [clock.tick, Deadline(1.0, 40, CAP)], clock)
    assert training.schedule == Schedule.straight(40)


def test_what_the_clock_made_of_a_schedule_can_be_made_again_without_one(begun, toy_dataset):
    first, clock = begun(), Clock(lambda t: 0.01 if t.iteration < 25 else 0.03)
    run(first, toy_dataset, 60, [clock.tick, Deadline(0.7, 1000, CAP)], clock)
    assert len(first.schedule.turns) > 2
    second = begun()
    second.schedule = Schedule.of(first.schedule.turns)
    run(second, toy_dataset, 60)
    assert_same(first, second)


def test_quality_that_stands_still_is_told_from_quality_that_rises():
    def at(values, total=160):
        schedule = Schedule.straight(total)
        curve = [Moment(10 * (i + 1), float(i), db) for i, db in enumerate(values)]
        return SimpleNamespace(schedule=schedule, curve=curve, ending="", iteration=10 * len(values))

    rising = [20 + 0.3 * i for i in range(8)]
    flat = [*rising[:4], 21.0, 21.02, 20.99, 21.01, 21.0]
    assert EarlyStop()(at(rising)) is None
    training = at(flat)
    assert EarlyStop()(training) == round(COOL_DOWN * (160 - 90))
    assert training.ending == "early stop"
    assert EarlyStop()(training) is None  # once
    early = at(flat, total=1000)
    assert EarlyStop()(early) is None  # 9 % of the schedule are too little to judge by
    between = at(flat)
    between.iteration += 1
    assert EarlyStop()(between) is None  # nothing was measured just now


def test_no_moment_at_half_size_ends_a_training():
    """Flat up to the middle of the schedule, and rising by little after it."""
    curve = [Moment(10 * (i + 1), float(i), 20 + 0.02 * max(i - 7, 0)) for i in range(13)]

    def ends(moments, steer):
        training = SimpleNamespace(
            schedule=Schedule.straight(160), curve=curve[:moments], ending="", iteration=10 * moments
        )
        return steer(training) is not None

    whole, halved = EarlyStop(), EarlyStop(halved=True)
    assert [count for count in range(1, 14) if ends(count, whole)] == list(range(5, 14))
    assert [count for count in range(1, 14) if ends(count, halved)] == [13]


@pytest.mark.parametrize(("fewest", "moments"), [(0, 13), (100_000, 5)])
def test_a_reconstruction_judges_views_that_come_to_full_size_by_it_alone(
    session_copy, monkeypatch, fewest, moments
):
    """The first judgement ends it, whatever it sees: after five moments in sixteen, or five at full size."""
    monkeypatch.setattr(half_size, "FEWEST", fewest)
    monkeypatch.setattr(stage, "EarlyStop", partial(EarlyStop, least=100.0))
    monkeypatch.setattr(live_curve, "ITERATIONS_A_RENDER", 1)
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=32, gaussians=CAP, width=64))
    model = read_model(stage.reconstruct(session_copy, TrainingRequest(quality="draft", early_stop=True)))
    assert model.ending == "early stop"
    (why,) = [rung.reason for rung in model.rungs if rung.name == "early stop"]
    assert f"hardly rose any more after {2 * moments}," in why


def test_a_converged_scene_stops_by_itself_and_cools_down(begun, toy_dataset):
    """It ends with the rates at their ends, as long as planned from the stop on."""
    short = begun()
    lines = run(short, toy_dataset, 320, [EarlyStop(least=1.0)])
    assert short.ending == "early stop"
    (_, (stopped, place), end) = short.schedule.turns
    assert stopped == place
    assert end == (stopped + round(COOL_DOWN * (320 - stopped)), 320)
    assert short.iteration == lines[-1]["iteration"] == end[0] < 320
    again = begun()
    run(again, toy_dataset, 320, [EarlyStop(least=1.0)])
    assert_same(short, again)


def test_a_scene_that_stops_by_itself_loses_little(begun, toy_dataset):
    """In the mean over seeds: one training differs from another by some tenths of a dB."""
    lost = []
    for seed in range(2):
        whole, short = begun(), begun()
        run(whole, toy_dataset, 320, seed=seed)
        run(short, toy_dataset, 320, [EarlyStop(least=1.0)], seed=seed)
        assert short.ending == "early stop"
        lost.append(whole.curve[-1].db - short.curve[-1].db)
    assert np.mean(lost) < 1.0


@pytest.mark.parametrize("stop", [13, 72])
def test_stopped_by_hand_and_gone_on_it_stops_where_it_would_have(begun, toy_dataset, tmp_path, stop):
    """Before and after the cool-down began."""
    steers = [EarlyStop(least=100.0, moments=2)]
    whole, first = begun(), begun()
    run(whole, toy_dataset, 160, steers)
    run(first, toy_dataset, 160, steers, until=stop)
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(first, {}))
    read = read_checkpoint(tmp_path / "c.safetensors")
    second = restored(METHODS["nh-3dgs"](toy_dataset, light_in(read)), read, toy_dataset.extent)
    run(second, toy_dataset, 160, steers)
    assert whole.ending == second.ending == "early stop"
    assert whole.schedule == second.schedule
    assert [(m.iteration, m.db) for m in whole.curve] == [(m.iteration, m.db) for m in second.curve]
    assert_same(whole, second)


def test_what_the_test_views_show_ends_no_training(begun, toy_dataset):
    """One of two held-out views is for validation; the other may show anything."""
    test_view = toy_dataset.held_out[0]
    other = replace(test_view, frame=test_view.frame + 1)
    blank = replace(other, shots=tuple(shot.showing(pixels=0 * shot.pixels) for shot in other.shots))
    whole, spoiled = (replace(toy_dataset, held_out=(view, test_view)) for view in (other, blank))
    steers = [EarlyStop(least=100.0, moments=2)]

    def curve(dataset):
        training = begun()
        run(training, dataset, 80, steers)
        assert training.ending == "early stop"
        return [(moment.iteration, moment.db) for moment in training.curve]

    assert whole.with_validation().test == (other,)
    assert curve(whole.with_validation()) == curve(spoiled.with_validation())
    assert curve(whole) != curve(spoiled)


def test_a_goal_ends_the_training_when_it_is_reached_and_only_then(begun, toy_dataset):
    reached, missed = begun(), begun()
    run(reached, toy_dataset, 100, [Goal(15.0)])
    assert reached.ending == "goal"
    assert reached.iteration < 50
    assert reached.curve[-1].db >= 15
    run(missed, toy_dataset, 30, [Goal(90.0)])
    assert (missed.ending, missed.iteration) == ("", 30)


def test_measuring_is_rare_and_changes_nothing(begun, toy_dataset):
    with_curve, without = begun(), begun()
    lines = run(with_curve, toy_dataset, 80)
    train(without, toy_dataset, Plan(80, DensityRules(CAP)))
    assert_same(with_curve, without)
    assert [line["held_out_db"] for line in lines] == [round(m.db, 4) for m in with_curve.curve]
    assert not without.curve
    for iterations, views in ((100, 1), (500, 4), (2000, 4), (4000, 1), (10, 4)):
        moments = iterations / period(iterations, views)
        assert moments <= 16
        assert moments * views <= max(iterations / 10, views)
    views = [replace(toy_dataset.held_out[0], frame=frame) for frame in range(30)]
    assert len(chosen_views(views)) == 4
    assert len(set(chosen_views(views[:3]))) == 3


def test_held_out_views_that_masks_hide_measure_nothing_and_end_nothing(begun, toy_dataset):
    (view,) = toy_dataset.held_out
    masked = tuple(shot.showing(valid=np.zeros(shot.shape, bool)) for shot in view.shots)
    hidden = replace(toy_dataset, held_out=(replace(view, shots=masked),))
    training = begun()
    run(training, hidden.with_validation(), 32, [EarlyStop(least=100.0, moments=2), Goal(1.0)])
    assert (training.ending, training.curve, training.iteration) == ("", [], 32)
    with pytest.raises(ReconstructionError, match=r"Masks hide all held-out views of .*: mend the masks, or"):
        stage._require_held_out(hidden)
    stage._require_held_out(toy_dataset)
