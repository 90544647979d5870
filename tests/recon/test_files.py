"""What is written and read back: splats.ply and checkpoints."""

import numpy as np
import pytest
import torch

from imaging.errors import ReconstructionError
from recon.appearance import LuminanceChromaticity, PlainHarmonics
from recon.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from recon.gaussians import Gaussians
from recon.harmonics import C0, COEFFICIENTS, series
from recon.ply import properties, radiance_harmonics, read_ply, write_ply


def make_gaussians(appearance, count=7) -> Gaussians:
    generator = torch.Generator().manual_seed(4)
    colours = appearance.start(torch.rand(count, 3, generator=generator) * 50)
    rest = next(name for name in colours if name.endswith("_rest"))
    colours[rest] = 0.2 * torch.randn(count, COEFFICIENTS - 1, 3, generator=generator)
    return Gaussians(
        {
            "means": torch.randn(count, 3, generator=generator),
            "log_scales": torch.randn(count, 3, generator=generator),
            "quats": torch.randn(count, 4, generator=generator),
            "opacity_logits": torch.randn(count, generator=generator),
            **colours,
        }
    )


def test_ply_round_trip_in_the_layout_of_3dgs(tmp_path):
    gaussians = make_gaussians(PlainHarmonics())
    path = tmp_path / "splats.ply"
    write_ply(path, gaussians, PlainHarmonics(), 2, 1.0, "a note")
    table = read_ply(path)
    assert tuple(table) == properties(2)
    parameters = gaussians.parameters
    for index, axis in enumerate("xyz"):
        np.testing.assert_array_equal(table[axis], parameters["means"][:, index].numpy())
        np.testing.assert_array_equal(table[f"scale_{index}"], parameters["log_scales"][:, index].numpy())
    np.testing.assert_array_equal(table["opacity"], parameters["opacity_logits"].numpy())
    quats = np.stack([table[f"rot_{part}"] for part in range(4)], 1)
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1, rtol=1e-6)
    # Where the plain series stays positive it is written as it is; red first, all its coefficients.
    rest = np.stack([table[f"f_rest_{index}"] for index in range(24)], 1).reshape(7, 3, 8).transpose(0, 2, 1)
    bright = (parameters["sh_dc"][:, 0] * C0 + 0.5).amin(1) > 3
    assert bright.any()
    np.testing.assert_allclose(rest[bright], parameters["sh_rest"][bright], atol=2e-4)
    np.testing.assert_allclose(
        np.stack([table[f"f_dc_{c}"] for c in range(3)], 1)[bright], parameters["sh_dc"][bright, 0], rtol=1e-4
    )


@pytest.mark.parametrize(("degree", "rest"), [(0, 0), (1, 9), (2, 24)])
def test_ply_holds_the_harmonics_of_the_degree_and_no_more(tmp_path, degree, rest):
    gaussians = make_gaussians(PlainHarmonics())
    gaussians.parameters["sh_dc"] += 10  # stays positive all around: nothing is cut off
    path = tmp_path / "splats.ply"
    write_ply(path, gaussians, PlainHarmonics(), degree, 1.0, "a note")
    table = read_ply(path)
    assert sum(name.startswith("f_rest_") for name in table) == rest
    assert path.stat().st_size == path.read_bytes().index(b"end_header\n") + 11 + 7 * 4 * (14 + rest)
    read = np.array([table[f"f_rest_{index}"] for index in range(rest)]).reshape(3, rest // 3, 7)
    wanted = gaussians.parameters["sh_rest"][:, : rest // 3].numpy()
    np.testing.assert_allclose(read.transpose(2, 1, 0), wanted, atol=1e-4)
    for channel in range(3):
        constant = gaussians.parameters["sh_dc"][:, 0, channel]
        np.testing.assert_allclose(table[f"f_dc_{channel}"], constant, rtol=1e-4)


def test_ply_holds_radiance_beyond_one_and_its_harmonics_are_near_the_appearance():
    appearance = LuminanceChromaticity()
    gaussians = make_gaussians(appearance)
    harmonics = torch.from_numpy(radiance_harmonics(gaussians, appearance, 2))
    directions = torch.nn.functional.normalize(
        torch.randn(7, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64), dim=1
    )
    shown = series(harmonics[:, :1], harmonics[:, 1:], directions, 2)
    wanted = appearance.colours(gaussians.parameters, directions.float(), 2)
    assert wanted.max() > 10
    np.testing.assert_allclose(shown, wanted, rtol=0.08, atol=0.02 * float(wanted.max()))


@pytest.mark.parametrize("cut", [10, 300, -4])
def test_a_damaged_ply_is_refused_in_one_sentence(tmp_path, cut):
    path = tmp_path / "splats.ply"
    write_ply(path, make_gaussians(PlainHarmonics()), PlainHarmonics(), 2, 1.0, "note")
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(ReconstructionError):
        read_ply(path)


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
