"""Snapshots of a training, for whoever asks; none of them changes it."""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from imaging.errors import StorageError
from imaging.session.lock import is_held
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.live_scene import SNAPSHOT, WANTED, Snapshots, ask, read_snapshot
from recon.result.model import CHECKPOINT, read_model
from recon.scene.checkpoint import read_checkpoint


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setitem(QUALITIES, "draft", Quality(20, 200, 32))


class Watcher:
    """Asks at the log's first line, with a clock on which every iteration takes longer than a checkpoint."""

    def __init__(self, monkeypatch, folder: Path) -> None:
        self.folder, self.lines, self.snapshots = folder, [], []
        ticks, write = itertools.count(0.0, 30.0), Snapshots.write
        self.clock = lambda: next(ticks)

        def written(snapshots):
            write(snapshots)
            self.snapshots.append((read_snapshot(folder), read_checkpoint(folder / CHECKPOINT)))

        monkeypatch.setattr(Snapshots, "write", written)

    def log(self, line) -> None:
        assert is_held(self.folder)
        if not self.lines:
            ask(self.folder)
        self.lines.append(line)


def test_a_snapshot_is_the_training_and_does_not_change_it(session_copy, monkeypatch):
    folder = session_copy / "reconstructions" / "seen"
    watcher = Watcher(monkeypatch, folder)
    request = TrainingRequest(quality="draft", name="seen")
    assert reconstruct(session_copy, request, on_log=watcher.log, clock=watcher.clock) == folder
    ((snapshot, checkpoint),) = watcher.snapshots
    first = watcher.lines[0]["iteration"]
    assert snapshot.scene.record.iterations == checkpoint.facts["iteration"] == first
    assert snapshot.total == read_model(folder).iterations > first
    for name, value in checkpoint.part("gaussians").items():
        assert torch.equal(snapshot.scene.gaussians.parameters[name], value)
    view = snapshot.scene.views[0]
    assert snapshot.scene.render(view).shape == (view.lens.height, view.lens.width, 3)
    assert not is_held(folder)
    assert not [name for name in (WANTED, SNAPSHOT) if (folder / name).exists()]
    plain = reconstruct(session_copy, replace(request, name="plain"), clock=watcher.clock)
    assert len(watcher.snapshots) == 1
    assert (plain / "splats.ply").read_bytes() == (folder / "splats.ply").read_bytes()


def test_snapshots_take_a_small_share_of_the_time(tmp_path, monkeypatch):
    now = [100.0]
    snapshots = Snapshots(tmp_path, None, None, clock=lambda: now[0])

    def written(path, checkpoint):
        now[0] += 0.5

    monkeypatch.setattr("recon.result.live_scene.write_checkpoint", written)
    monkeypatch.setattr(Snapshots, "_checkpoint", lambda self: None)
    assert not snapshots.wanted()
    ask(tmp_path)
    assert not snapshots.wanted()  # it looked a moment ago
    now[0] += 1
    assert snapshots.wanted()
    snapshots.write()
    assert not (tmp_path / WANTED).exists()
    ask(tmp_path)
    now[0] += 0.9
    assert not snapshots.wanted()
    now[0] += 0.3  # the first is not counted
    assert snapshots.wanted()
    snapshots.write()
    ask(tmp_path)
    now[0] += 24.4
    assert not snapshots.wanted()
    now[0] += 0.2  # 0.5 s of 25 are 2 %
    assert snapshots.wanted()


def test_a_disk_that_refuses_a_snapshot_ends_no_training(tmp_path, monkeypatch):
    def full(path, checkpoint):
        raise StorageError("full")

    monkeypatch.setattr("recon.result.live_scene.write_checkpoint", full)
    monkeypatch.setattr(Snapshots, "_checkpoint", lambda self: None)
    Snapshots(tmp_path, None, None).write()
    with pytest.raises(StorageError, match=r"live\.wanted could not be written"):
        ask(tmp_path / "nowhere")
