"""Checkpoints, written and read back."""

import pytest
import torch

from imaging.errors import ReconstructionError
from recon.scene.checkpoint import Checkpoint, read_checkpoint, write_checkpoint


def test_checkpoint_round_trip(tmp_path):
    tensors = {"gaussians.means": torch.randn(5, 3), "adam.means.step": torch.tensor(7.0)}
    checkpoint = Checkpoint(tensors, {"iteration": 12, "settings": {"seed": 3}})
    write_checkpoint(tmp_path / "c.safetensors", checkpoint)
    read = read_checkpoint(tmp_path / "c.safetensors")
    assert read.facts == checkpoint.facts
    assert torch.equal(read.part("gaussians")["means"], tensors["gaussians.means"])
    assert float(read.part("adam")["means.step"]) == 7.0


@pytest.mark.parametrize(
    "damage", [lambda data: data[:50], lambda data: b"\xff" * 9, lambda data: b"", lambda data: data[:-3]]
)
def test_a_damaged_checkpoint_is_refused(tmp_path, damage):
    path = tmp_path / "c.safetensors"
    write_checkpoint(path, Checkpoint({"gaussians.means": torch.randn(5, 3)}, {"iteration": 1}))
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(ReconstructionError, match=r"c\.safetensors"):
        read_checkpoint(path)


def test_a_missing_checkpoint_is_refused(tmp_path):
    with pytest.raises(ReconstructionError, match="missing"):
        read_checkpoint(tmp_path / "none")
