"""PLY files of Gaussians: what is written is what another reader of the format reads and draws."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from recon.data.world import WorldTransform
from recon.scene.appearance import LuminanceChromaticity, PlainHarmonics
from recon.scene.gaussians import Gaussians, Renderer
from recon.scene.harmonics import COEFFICIENTS, series
from recon.scene.ply import plain_harmonics, properties, write_ply
from recon.splat import Limits, SplatCamera
from tests.recon import foreign_3dgs
from tests.recon.ply_files import read_ply


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


def written(path, gaussians, appearance, degree=2, **options):
    write_ply(path, gaussians, plain_harmonics(gaussians, appearance, degree), ["a note"], **options)
    return path


def directions(count):
    generator = torch.Generator().manual_seed(1)
    return torch.nn.functional.normalize(
        torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=1
    )


def test_the_layout_is_that_of_3dgs(tmp_path):
    gaussians = make_gaussians(PlainHarmonics())
    table = read_ply(written(tmp_path / "splats.ply", gaussians, PlainHarmonics()))
    assert tuple(table) == properties(2)
    parameters = gaussians.parameters
    for index, axis in enumerate("xyz"):
        np.testing.assert_array_equal(table[axis], parameters["means"][:, index].numpy())
        np.testing.assert_array_equal(table[f"scale_{index}"], parameters["log_scales"][:, index].numpy())
    np.testing.assert_array_equal(table["opacity"], parameters["opacity_logits"].numpy())
    quats = np.stack([table[f"rot_{part}"] for part in range(4)], 1)
    np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1, rtol=1e-6)
    head = (tmp_path / "splats.ply").read_bytes().partition(b"end_header\n")[0].decode("ascii").splitlines()
    assert head[:4] == ["ply", "format binary_little_endian 1.0", "comment a note", "element vertex 7"]
    assert head[4:] == [f"property float {name}" for name in properties(2)]


def test_the_first_layout_of_3dgs_has_normals_of_zero_behind_the_places(tmp_path):
    gaussians = make_gaussians(PlainHarmonics())
    without = read_ply(written(tmp_path / "a.ply", gaussians, PlainHarmonics()))
    table = read_ply(written(tmp_path / "b.ply", gaussians, PlainHarmonics(), normals=True))
    assert tuple(table)[:7] == ("x", "y", "z", "nx", "ny", "nz", "f_dc_0")
    for name in table:
        np.testing.assert_array_equal(table[name], 0 if name in ("nx", "ny", "nz") else without[name])


@pytest.mark.parametrize(("degree", "rest"), [(0, 0), (1, 9), (2, 24)])
def test_the_harmonics_of_3dgs_are_written_as_they_are_and_no_more_than_the_degree(tmp_path, degree, rest):
    gaussians = make_gaussians(PlainHarmonics())
    path = written(tmp_path / "splats.ply", gaussians, PlainHarmonics(), degree)
    table = read_ply(path)
    assert sum(name.startswith("f_rest_") for name in table) == rest
    assert path.stat().st_size == path.read_bytes().index(b"end_header\n") + 11 + 7 * 4 * (14 + rest)
    read = np.array([table[f"f_rest_{index}"] for index in range(rest)]).reshape(3, rest // 3, 7)
    wanted = gaussians.parameters["sh_rest"][:, : rest // 3].numpy()
    np.testing.assert_array_equal(read.transpose(2, 1, 0), wanted)
    for channel in range(3):
        constant = gaussians.parameters["sh_dc"][:, 0, channel]
        np.testing.assert_array_equal(table[f"f_dc_{channel}"], constant)


def test_another_reader_sees_the_colours_of_3dgs_also_where_channels_are_cut_off_at_zero(tmp_path):
    gaussians = make_gaussians(PlainHarmonics(), count=150)
    gaussians.parameters["sh_dc"] = 0.05 * gaussians.parameters["sh_dc"] - 3
    table = foreign_3dgs.read(written(tmp_path / "splats.ply", gaussians, PlainHarmonics()))
    towards = directions(150)
    ours = PlainHarmonics().colours(gaussians.parameters, towards.float(), 2).numpy()
    assert 0.05 < (ours == 0).mean() < 0.5
    np.testing.assert_allclose(foreign_3dgs.colours(table, towards.numpy()), ours, atol=1e-5)


@pytest.mark.parametrize("appearance", [PlainHarmonics(), LuminanceChromaticity()])
@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_another_program_draws_what_rig_draws(tmp_path, appearance, unit):
    """Opacities, sizes, turns, places and signs of the harmonics mean there what they mean here."""
    rng = np.random.default_rng(3)
    gaussians = make_gaussians(appearance, count=60)
    gaussians.parameters["means"] *= 0.6
    gaussians.parameters["log_scales"] = torch.from_numpy(rng.normal(-2.2, 0.5, (60, 3))).float()
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_euler("xyz", [0.2, -0.3, 0.5]).as_matrix()
    motion[:3, 3] = unit * np.array([0.1, -0.2, 4.0]) - unit * motion[:3, :3] @ (5e4, -2e4, 0.0)
    camera = SplatCamera(motion, 90, 95, 41.3, 28.7, 80, 60)
    world = WorldTransform(origin=(5e4 * unit, -2e4 * unit, 0.0), unit=unit)
    offset = world.offset(95)
    assert any(offset)
    degree = 2 if isinstance(appearance, PlainHarmonics) else 0  # of which the series is exact
    path = written(tmp_path / "a.ply", gaussians, appearance, degree, world=world, offset=offset)
    ours = Renderer(appearance, Limits.gsplat())(
        gaussians, world.camera(camera), degree=degree
    ).image.detach()
    motion[:3, 3] += motion[:3, :3] @ offset
    theirs = foreign_3dgs.draw(foreign_3dgs.read(path), camera, near=0.01 * unit)
    assert ours.max() > 1
    np.testing.assert_allclose(theirs, ours, atol=2e-3 * float(ours.max()))
    assert np.sqrt(np.mean((theirs - ours.numpy()) ** 2)) < 2e-4 * float(ours.max())


def test_radiance_beyond_one_is_held_and_its_harmonics_are_near_the_appearance():
    appearance = LuminanceChromaticity()
    gaussians = make_gaussians(appearance)
    harmonics = torch.from_numpy(plain_harmonics(gaussians, appearance, 2))
    towards = directions(7)
    shown = series(harmonics[:, :1], harmonics[:, 1:], towards, 2) + 0.5
    wanted = appearance.colours(gaussians.parameters, towards.float(), 2)
    assert wanted.max() > 10
    np.testing.assert_allclose(shown, wanted, rtol=0.08, atol=0.02 * float(wanted.max()))
