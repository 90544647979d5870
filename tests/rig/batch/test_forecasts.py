"""Forecasts of steps: more of larger photographs, of more of them, and of larger scenes."""

import shutil
from pathlib import Path

import pytest

from imaging.compute.workers import LocalWorkers
from imaging.errors import InputError
from imaging.session.session import Session
from recon.result.model import SPLATS
from rig.batch import forecasts
from rig.batch.batch_plan import PlannedScene


def test_a_calibration_grows_with_photographs_and_their_size(toy: Path, tmp_path: Path) -> None:
    lines = (toy / "shots.jsonl").read_text().splitlines()
    shots = Session.open(toy).shots("scene")
    fewer, larger = tmp_path / "fewer", tmp_path / "larger"
    for folder in (fewer, larger):
        shutil.copytree(toy, folder)
    (fewer / "shots.jsonl").write_text("\n".join(line for line in lines if '"frame": 0' in line) + "\n")
    wide = "\n".join(line.replace('"width": 64', '"width": 64000') for line in lines) + "\n"
    assert wide != "\n".join(lines) + "\n"
    (larger / "shots.jsonl").write_text(wide)
    usual = forecasts.calibration(toy)
    views = len({(shot.frame, shot.camera) for shot in shots})
    assert usual.memory - forecasts.calibration(fewer).memory == forecasts.VIEW * (views - 2)
    more = forecasts.calibration(larger).memory - usual.memory
    assert more == forecasts.PIXEL * (64000 - 64) * 48
    assert not usual.gpu


def test_a_training_is_as_its_settings_say(toy: Path) -> None:
    workers = LocalWorkers(1)
    small = forecasts.training(toy, PlannedScene(set={"gaussians": 1000}), workers)
    large = forecasts.training(toy, PlannedScene(set={"gaussians": 1_000_000}), workers)
    budget = forecasts.training(toy, PlannedScene(budget="1000k"), workers)
    assert small.gpu
    assert small.memory < budget.memory < large.memory - 100_000_000  # as many as there are pixels
    workers.room = 1
    with pytest.raises(InputError, match="more of memory where 0 MB are free"):
        forecasts.training(toy, PlannedScene(), workers)


def test_an_export_grows_with_its_scene(tmp_path: Path) -> None:
    (tmp_path / SPLATS).write_bytes(bytes(1000))
    more = forecasts.export(tmp_path).memory - forecasts.export(tmp_path / "none").memory
    assert more == forecasts.SPLAT * 1000
