"""Training at toy size: it learns, it resumes bit for bit, it stops when told."""

import ast
import os
import re
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from imaging import metrics
from recon.data.load import load
from recon.data.shot import HeldPlanes
from recon.measure.truth import true_radiance
from recon.methods import METHODS
from recon.scene.checkpoint import read_checkpoint, write_checkpoint
from recon.scene.gaussians import Gaussians
from recon.train.densification import DensityRules
from recon.train.monitor import Hooks
from recon.train.trainer import train
from recon.train.training import Plan, Training
from recon.train.training_checkpoint import checkpoint_of, light_in, restored
from tests.recon.beginning import beginning

CAP = 900


@pytest.fixture(scope="module")
def begun(toy_dataset):
    """A function that makes a new training of a method on the toy session, always the same."""
    return beginning(toy_dataset, 600)


def run(training, dataset, plan, until=None):
    lines, saves = [], []
    train(
        training,
        dataset,
        plan,
        Hooks(log=lines.append, save=lambda: saves.append(training.iteration)),
        until=until,
    )
    return lines, saves


def quality(training, dataset):
    """mu-law PSNR of the held-out view against the truth, dB, and the median error in stops."""
    (view,) = dataset.held_out
    with torch.no_grad():
        image = training.renderer()(training.gaussians, view.lens, degree=2).image
    light = training.method.observation.radiance(image).numpy()
    truth = true_radiance(dataset.session, view)
    return metrics.hdr_psnr_mu(light, truth), metrics.stops_median(light, truth)


def test_it_learns_the_held_out_view(begun, toy_dataset):
    training = begun()
    before, _ = quality(training, toy_dataset)
    lines, _ = run(training, toy_dataset, Plan(150, DensityRules(CAP), log_every=25))
    after, stops = quality(training, toy_dataset)
    assert [line["iteration"] for line in lines] == [25, 50, 75, 100, 125, 150]
    assert lines[-1]["loss"] < 0.75 * lines[0]["loss"]
    assert after > before + 3
    assert after > 25
    assert stops < 0.35
    assert len(training.gaussians) == CAP


def of_the_guide(heading: str) -> str:
    """Code of a section of docs/python.md."""
    text = (Path(__file__).parents[3] / "docs" / "python.md").read_text(encoding="utf-8")
    section = re.split(r"\n##+ ", text.partition(f"### {heading}\n")[2])[0]
    return "\n".join(line[4:] for line in section.splitlines() if line.startswith("    ") or not line)


def test_a_training_takes_the_loss_of_the_guide(begun, toy_dataset, capsys):
    training, plan = begun(), Plan(20, DensityRules(CAP), log_every=5)
    names = {"training": training, "dataset": toy_dataset, "plan": plan}
    exec(of_the_guide("Custom loss"), names)
    lines = [ast.literal_eval(line) for line in capsys.readouterr().out.splitlines()]
    assert training.method.loss is names["loss"]
    assert lines[-1]["loss"] < lines[0]["loss"] < 0.1  # squares of the signal, and no L1 or SSIM


def test_a_training_takes_the_density_control_of_the_guide(begun, toy_dataset, capsys):
    """docs/python.md halves the Gaussians in the middle; the rules of the plan would have grown them."""
    code = of_the_guide("Custom density control")
    training, plan = begun(), Plan(20, DensityRules(CAP), log_every=5)
    before = training.gaussians.parameters["means"].detach().clone()
    exec(code, {"training": training, "dataset": toy_dataset, "plan": plan})
    assert len(training.gaussians) == len(before) // 2
    lines = [ast.literal_eval(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["gaussians"] for line in lines] == [len(before)] + 3 * [len(before) // 2]
    assert (
        len(training.optimizer.state[training.gaussians.parameters["means"]]["exp_avg"]) == len(before) // 2
    )


def test_the_baseline_learns_too(begun, toy_dataset):
    training = begun("vanilla")
    before, _ = quality(training, toy_dataset)
    run(training, toy_dataset, Plan(100, DensityRules(CAP)))
    assert quality(training, toy_dataset)[0] > before + 1


def state(training: Training) -> dict[str, torch.Tensor]:
    tensors = checkpoint_of(training, {}).tensors
    return {name: value for name, value in tensors.items() if torch.is_tensor(value)}


def assert_same(first: Training, second: Training) -> None:
    one, two = state(first), state(second)
    assert set(one) == set(two)
    for name, value in one.items():
        assert torch.equal(value, two[name]), name


@pytest.mark.parametrize("stop", [7, 24, 40])
def test_a_training_that_was_stopped_goes_on_bit_for_bit(begun, toy_dataset, tmp_path, stop):
    """Stopped before, just after and well after an adaptation, through a file."""
    plan = Plan(60, DensityRules(CAP, every=0.1))
    whole = begun()
    run(whole, toy_dataset, plan)
    first = begun()
    run(first, toy_dataset, plan, until=stop)
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(first, {}))
    read = read_checkpoint(tmp_path / "c.safetensors")
    method = METHODS["nh-3dgs"](toy_dataset, light_in(read))
    second = restored(method, read, toy_dataset.extent)
    assert second.iteration == stop
    run(second, toy_dataset, plan)
    assert_same(whole, second)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(begun, toy_dataset):
    first, second, third = begun(), begun(), begun()
    run(first, toy_dataset, Plan(20, DensityRules(CAP), seed=3))
    run(second, toy_dataset, Plan(20, DensityRules(CAP), seed=3))
    run(third, toy_dataset, Plan(20, DensityRules(CAP), seed=4))
    assert_same(first, second)
    assert not torch.equal(first.gaussians.parameters["means"], third.gaussians.parameters["means"])


def test_an_interrupt_saves_between_two_iterations_and_then_stops(begun, toy_dataset):
    training = begun()
    saved = []

    def log(line):
        if line["iteration"] == 10:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        train(
            training,
            toy_dataset,
            Plan(50, DensityRules(CAP), log_every=5),
            Hooks(log=log, save=lambda: saved.append(training.iteration)),
        )
    assert saved == [10]
    assert training.iteration == 10
    assert signal.getsignal(signal.SIGINT) is before


def test_checkpoints_come_every_so_often(begun, toy_dataset):
    _, saves = run(begun(), toy_dataset, Plan(6, DensityRules(CAP), checkpoint_seconds=0.0))
    assert saves == [1, 2, 3, 4, 5, 6]


def test_hdr_gs_learns_light_and_curve_from_photographs(toy_ldr):
    dataset = load(toy_ldr)
    training = beginning(dataset, 600)("hdr-gs")
    method = training.method
    curve = method.observation.theta.detach().clone()
    before, _ = quality(training, dataset)
    run(training, dataset, Plan(10, DensityRules(CAP)), until=2)
    assert torch.equal(method.observation.theta, curve)  # stage 1: the curve stands still
    run(training, dataset, Plan(100, DensityRules(CAP)))
    assert not torch.equal(method.observation.theta, curve)
    values = method.observation.curves()
    assert (values[..., 1:] >= values[..., :-1]).all()
    after, stops = quality(training, dataset)
    assert after > before + 1
    assert stops < 0.5


@pytest.mark.parametrize("what", ["black", "saturated"])
def test_scenes_without_information_stay_finite(begun, toy_dataset, what):
    """All frames black, or all saturated: nothing to learn, and nothing may break."""
    views = []
    for view in toy_dataset.train:
        shots = []
        for shot in view.shots:
            full = np.full(shot.pixels.shape, what == "saturated")
            planes = HeldPlanes(full.astype(np.float32), full, ~full & False, shot.valid)
            shots.append(type(shot)(shot.file, shot.k, planes))
        views.append(type(view)(view.camera, view.frame, view.lens, view.sensor, tuple(shots)))
    dataset = replace(toy_dataset, train=tuple(views), held_out=())
    training = beginning(dataset, 400)()
    lines, _ = run(training, dataset, Plan(30, DensityRules(500), log_every=10))
    assert all(np.isfinite(line["loss"]) for line in lines)
    assert all(torch.isfinite(value).all() for value in training.gaussians.parameters.values())
    with torch.no_grad():
        image = training.renderer()(training.gaussians, dataset.train[0].lens, degree=2).image
    assert torch.isfinite(image).all()
    if what == "black":
        assert float(image.max()) < 1e-3


def test_restored_gaussians_are_those_that_were_saved(begun):
    training = begun()
    checkpoint = checkpoint_of(training, {"note": 1})
    assert isinstance(Gaussians(checkpoint.part("gaussians")), Gaussians)
    for name, value in training.gaussians.parameters.items():
        assert torch.equal(checkpoint.part("gaussians")[name], value)
