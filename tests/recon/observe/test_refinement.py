"""Corrections of the calibration by training: truth, gauges, gradients, resuming, records."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from imaging.files import store
from recon.data.geometry import project
from recon.data.load import load
from recon.decide.held_out_evidence import robust_score_db
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.decide.steps.corrections import ALL
from recon.methods import METHODS
from recon.observe.refinement import Refinement, camera_delta
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.result.opened import open_model
from recon.scene.checkpoint import read_checkpoint, write_checkpoint
from recon.scene.gaussians import Gaussians, Renderer, limits_for
from recon.splat.corrected_camera import moved
from recon.train.densification import DensityRules
from recon.train.trainer import train
from recon.train.training import Plan, Training
from recon.train.training_checkpoint import checkpoint_of, light_in, restored
from tests.recon.beginning import beginning

EXPOSURE_ERROR, VIGNETTING_ERROR = 0.05, (0.2, 0.1, -0.05)


@pytest.fixture(scope="module")
def true(toy_long):
    """Sixteen views of the toy rig with their true calibration."""
    return toy_long


@pytest.fixture(scope="module")
def wrong(true):
    """The same with poses off by half a degree and 1 %, exposures by 5 %, corners by a quarter."""
    rng = np.random.default_rng(1)

    def unit():
        way = rng.normal(size=3)
        return way / np.linalg.norm(way)

    def spoilt(view):
        delta = torch.tensor([*(0.01 * true.extent * unit()), *(np.radians(0.5) * unit()), *[0.0] * 8])
        factors = np.exp(EXPOSURE_ERROR * rng.normal(size=len(view.shots)))
        shots = [replace(shot, k=shot.k * float(f)) for shot, f in zip(view.shots, factors, strict=True)]
        return replace(darker(view), lens=moved(view.lens, delta)[0], shots=tuple(shots))

    def darker(view):
        height, width = view.sensor.falloff.shape
        y, x = np.mgrid[:height, :width] + 0.5 - np.array([height, width])[:, None, None] / 2
        square = (x**2 + y**2) / ((height / 2) ** 2 + (width / 2) ** 2)
        factor = 1 + sum(term * square**power for power, term in enumerate(VIGNETTING_ERROR, 1))
        falloff = (view.sensor.falloff * factor).astype(np.float32)
        return replace(view, sensor=replace(view.sensor, falloff=falloff))

    return replace(true, train=tuple(map(spoilt, true.train)), held_out=tuple(map(darker, true.held_out)))


def begin(dataset, names, count=600) -> Training:
    return beginning(dataset, count)(refinement=Refinement.of(dataset, names))


def run(training, dataset, iterations, until=None):
    plan = Plan(iterations, DensityRules(1200))
    train(training, dataset, plan, until=until)


@pytest.fixture(scope="module")
def trained(wrong):
    """A training that believes the wrong calibration, and one that corrects it."""
    plain, freed = begin(wrong, ()), begin(wrong, ALL)
    run(plain, wrong, 300)
    run(freed, wrong, 300)
    return plain, freed


def pose_errors(dataset, true) -> np.ndarray:
    """Pose errors of every training view, root mean square px of scene points, whatever the gauge, [V]."""
    points = np.concatenate([view.centre + 2 * view.lens.cam_from_world[2, :3] for view in true.train])
    points = points.reshape(-1, 3) + np.random.default_rng(0).normal(scale=0.3, size=(len(true.train), 3))
    deltas = []
    for one, other in zip(dataset.train, true.train, strict=True):
        motion = one.lens.cam_from_world @ np.linalg.inv(other.lens.cam_from_world)
        turn = motion[:3, :3]
        vector = [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        deltas.append([*(motion[:3, 3] / true.extent), *(0.5 * np.array(vector))])
    refinement = Refinement.of(true, ["poses"])
    refinement.parameters["poses"][:] = torch.tensor(np.array(deltas), dtype=torch.float32)
    refinement.settle()
    errors = []
    for one, other in zip(refinement.corrected().train, true.train, strict=True):
        off = project(one.lens, points)[0] - project(other.lens, points)[0]
        errors.append(np.sqrt((off**2).sum(1).mean()))
    return np.array(errors)


def test_a_wrong_calibration_is_brought_back(wrong, true, trained):
    freed = trained[1].refinement.corrected()
    before, after = np.median(pose_errors(wrong, true)), np.median(pose_errors(freed, true))
    assert before > 0.3  # px
    assert after < before / 3

    def ratios(dataset):
        logs = np.array([[np.log(shot.k) for shot in view.shots] for view in dataset.train])
        return logs - logs.mean(1, keepdims=True)

    assert np.std(ratios(wrong) - ratios(true)) > 0.03
    assert np.std(ratios(freed) - ratios(true)) < 0.015

    def corners(dataset):
        falloffs = zip(dataset.train, true.train, strict=True)
        shares = [one.sensor.falloff / other.sensor.falloff for one, other in falloffs]
        return np.mean([share[0, 0] / share[24, 32] - 1 for share in shares])

    assert abs(corners(wrong)) > 0.2
    assert abs(corners(freed)) < 0.5 * abs(corners(wrong))


def test_held_out_views_are_predicted_better(wrong, true, trained):
    """Know the true pose up to the gauge, which is fitted on one half of the picture."""
    plain, freed = (
        np.array([robust_score_db(one, view, ["poses"], wrong.extent) for view in wrong.held_out])
        for one in trained
    )
    assert (freed > plain).all()
    assert (freed - plain).mean() > 0.3


def spoilt(view, share=0.02):
    """The view with that share of its samples at the other end of the scale, as dead photosites have them."""
    rng = np.random.default_rng(3)

    def dead(pixels):
        return np.where(rng.random(pixels.shape) < share, 1 - pixels, pixels).astype(pixels.dtype)

    return replace(view, shots=tuple(shot.showing(pixels=dead(shot.pixels)) for shot in view.shots))


def test_a_few_wrong_samples_do_not_drown_what_the_others_tell(wrong, trained):
    """Compare with plain squares, which would lose most of the gain of a corrected calibration."""

    def gain(views):
        plain, freed = ([robust_score_db(one, view, (), wrong.extent) for view in views] for one in trained)
        return np.mean(np.subtract(freed, plain))

    clean = gain(wrong.held_out)
    assert clean > 0.3
    assert gain([spoilt(view) for view in wrong.held_out]) == pytest.approx(clean, rel=0.1)


def test_nor_do_they_in_photographs(toy_ldr):
    dataset = load(toy_ldr)
    begin_again = beginning(dataset, 300)
    off = torch.tensor([0.0] * 3 + [0.01, 0, 0] + [0.0] * 8)

    def gain(views):
        """Gain of the right pose over a wrong one; a method keeps the codes of a view, so each has its
        own.
        """
        training = begin_again("hdr-gs")
        run(training, dataset, 120)
        turned = [replace(view, lens=moved(view.lens, off)[0]) for view in views]
        right, other = (
            [robust_score_db(training, view, (), dataset.extent) for view in s] for s in (views, turned)
        )
        return np.mean(np.subtract(right, other))

    clean = gain(dataset.held_out)
    assert clean > 0.3
    assert gain([spoilt(view) for view in dataset.held_out]) == pytest.approx(clean, rel=0.1)


def test_what_is_not_sure_of_a_held_out_view_is_fitted_first(wrong, trained):
    (view, *_) = wrong.held_out
    off = torch.tensor([0.0] * 3 + [0.01, 0, 0] + [0.0] * 8)
    turned = replace(view, lens=moved(view.lens, off)[0])
    training = trained[1]
    straight = robust_score_db(training, view, [], wrong.extent)
    assert robust_score_db(training, turned, [], wrong.extent) < straight - 0.5
    fitted = [robust_score_db(training, one, ["poses"], wrong.extent) for one in (view, turned)]
    assert fitted[0] == pytest.approx(fitted[1], abs=0.3)


@pytest.mark.parametrize("off", [-0.35, 0.35])
def test_exposures_half_a_stop_off_are_fitted_as_well(wrong, trained, off):
    """A fit that stops before would count what is left as a fault of the training."""
    (view, *_) = wrong.held_out
    shots = tuple(replace(shot, k=shot.k * float(np.exp(off))) for shot in view.shots)
    # A method knows the exposures of a view by its name, so this one has its own.
    mislabelled, training = replace(view, frame=100 + (off > 0), shots=shots), trained[1]
    fitted = [robust_score_db(training, one, ["exposures"], wrong.extent) for one in (view, mislabelled)]
    assert fitted[0] == pytest.approx(fitted[1], abs=0.1)


def test_the_colour_of_a_held_out_photograph_is_fitted_first(toy_ldr):
    dataset = load(toy_ldr)
    training = beginning(dataset, 300)("hdr-gs")
    run(training, dataset, 60)
    (view, *_) = dataset.held_out
    cold = replace(view, frame=100, sensor=replace(view.sensor, white_balance=(0.7, 1.0, 1.4)))
    plain, fitted = (
        [robust_score_db(training, one, unsure, dataset.extent) for one in (view, cold)]
        for unsure in ((), ("gains",))
    )
    assert plain[1] < plain[0] - 0.3
    assert fitted[0] == pytest.approx(fitted[1], abs=0.1)


def test_a_motion_of_the_whole_world_is_no_correction(true):
    """Neither a turn, a shift nor a scale of it; and settling twice is settling once."""
    refinement = Refinement.of(true, ["poses", "exposures"])
    poses, logs = refinement.parameters["poses"], refinement.parameters["exposures"]
    turn, shift, scale = np.array([1.0, -2, 0.5]), np.array([0.3, 0.2, -1]), 0.7
    middle = np.mean([view.centre for view in true.train], axis=0)
    for row, view in enumerate(true.train):
        motion = view.lens.cam_from_world[:3, :3]
        off = motion @ (middle - view.centre)
        turn_of_view = motion @ turn
        away = (motion @ shift + np.cross(off, turn_of_view) + scale * off) / true.extent
        poses[row] = 1e-3 * torch.tensor(np.concatenate([away, turn_of_view]))
    logs += 0.3
    refinement.settle()
    assert poses.abs().max() < 1e-8
    assert logs.abs().max() < 1e-6
    poses += torch.randn(poses.shape, generator=torch.Generator().manual_seed(0))
    refinement.settle()
    once = poses.clone()
    assert 0.5 < float(once.norm()) ** 2 / once.numel() < 1
    refinement.settle()
    torch.testing.assert_close(once, poses, atol=1e-5, rtol=0)


def test_gradients_of_a_pose_are_those_of_finite_differences(true):
    rng = torch.Generator().manual_seed(2)
    view, extent = true.train[3], true.extent
    lens = replace(view.lens, width=24, height=18, **{k: getattr(view.lens, k) / 2.7 for k in ("fx", "fy")})
    lens = replace(lens, cx=12.0, cy=9.0)
    away = view.centre + 2 * view.lens.cam_from_world[2, :3]
    count = 12
    scene = {
        "means": torch.from_numpy(away) + 0.3 * torch.randn(count, 3, generator=rng, dtype=torch.float64),
        "log_scales": torch.full((count, 3), -2.0, dtype=torch.float64),
        "quats": torch.randn(count, 4, generator=rng, dtype=torch.float64),
        "opacity_logits": torch.zeros(count, dtype=torch.float64),
    }
    appearance = METHODS["nh-3dgs"](true, begin(true, (), 50).light).appearance
    scene |= appearance.start(torch.rand(count, 3, generator=rng, dtype=torch.float64))
    renderer = Renderer(appearance, limits_for(None))
    weights = torch.randn(18, 24, 3, generator=rng, dtype=torch.float64)
    pose = 0.01 * torch.randn(6, generator=rng, dtype=torch.float64)

    def loss(at):
        at = at.to(torch.float64)
        delta = camera_delta(at, extent)
        return (renderer(Gaussians(scene), lens, degree=0, camera_delta=delta).image * weights).sum()

    step = 1e-5 * torch.eye(6, dtype=torch.float64)
    expected = torch.stack([(loss(pose + e) - loss(pose - e)) / 2e-5 for e in step])
    fast = {name: value.float() for name, value in scene.items()}
    single = pose.float().requires_grad_(True)
    image = renderer(Gaussians(fast), lens, degree=0, camera_delta=camera_delta(single, extent)).image
    (image * weights).sum().backward()
    assert expected.abs().min() > 1e-3
    torch.testing.assert_close(
        single.grad.double(), expected, rtol=2e-3, atol=2e-3 * float(expected.abs().max())
    )


def test_a_corrected_training_goes_on_bit_for_bit(wrong, tmp_path):
    whole, first = begin(wrong, ALL, 200), begin(wrong, ALL, 200)
    run(whole, wrong, 30)
    run(first, wrong, 30, until=13)
    write_checkpoint(tmp_path / "c.safetensors", checkpoint_of(first, {}))
    read = read_checkpoint(tmp_path / "c.safetensors")
    method = METHODS["nh-3dgs"](wrong, light_in(read))
    refinement = Refinement.stored(wrong, read)
    second = restored(method, read, wrong.extent, refinement=refinement)
    run(second, wrong, 30)
    one, two = checkpoint_of(whole, {}).tensors, checkpoint_of(second, {}).tensors
    assert set(one) == set(two)
    assert {f"refinement.{name}" for name in ALL} < set(one)
    for name, value in one.items():
        assert torch.equal(value, two[name]), name
    assert bool(whole.refinement.parameters["poses"].any())


def test_nothing_moves_before_the_scene_has_taken_shape(wrong):
    training = begin(wrong, ALL, 200)
    run(training, wrong, 30, until=6)
    assert all(not value.any() for value in training.refinement.parameters.values())


def test_what_was_corrected_is_told_and_rendered(session_copy):
    overrides = Overrides.of(["refine=poses+exposures+vignetting+glare", "iterations=20", "gaussians=200"])
    folder = reconstruct(session_copy, TrainingRequest(quality="draft", overrides=overrides))
    record, facts = read_model(folder), store.read_json(folder / "refinement.json")
    rungs = {rung.name: rung for rung in record.rungs}
    assert all(
        rungs[f"refine {name}"].taken and rungs[f"refine {name}"].reason.startswith("asked for; ")
        for name in ALL
    )
    assert set(facts["poses"]) == set(record.training_views)
    assert all(0 < pose["rotation_deg"] < 5 for pose in facts["poses"].values())
    assert abs(sum(facts["exposures_stops"].values())) < 1e-5
    opened, plain = open_model(folder), load(session_copy, max_width=320)
    for one, other in zip(opened.dataset.train, plain.train, strict=True):
        assert not np.array_equal(one.lens.cam_from_world, other.lens.cam_from_world)
        assert one.shots[0].k != other.shots[0].k
    for one, other in zip(opened.dataset.held_out, plain.held_out, strict=True):
        assert np.array_equal(one.lens.cam_from_world, other.lens.cam_from_world)
        assert one.shots[0].k == other.shots[0].k
        assert not np.array_equal(one.sensor.falloff, other.sensor.falloff)
    again = reconstruct(session_copy, TrainingRequest(quality="draft", overrides=overrides))
    assert read_model(again).created == record.created
