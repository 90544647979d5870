"""SOG files, read by gsply and, where it is installed, by PlayCanvas's own splat-transform."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recon.exports.formats import palette as choice
from recon.exports.formats.codebook import SIZE, codebook, nearest
from recon.exports.formats.palette import palette
from recon.exports.formats.sog import packed_splats
from recon.exports.loss import floor_of, stops_between
from recon.exports.splats import Splats, as_splats, linear_splats
from recon.result.scene import open_scene
from recon.scene.ply_file import read_ply
from tests.foreign_gsply import gsply
from tests.splat_transform import needs_splat_transform, splat_transform


def splats_of(folder: Path) -> tuple[Splats, float]:
    scene = open_scene(folder)
    splats = linear_splats(scene, scene.exposure, with_dome=True)
    return splats, floor_of(scene) * splats.factor


@pytest.mark.parametrize("name", ["made", "made_sky", "made_shiny"])
def test_gsply_reads_the_gaussians_that_are_told(name: str, request: pytest.FixtureRequest) -> None:
    splats, floor = splats_of(request.getfixturevalue(name))
    data, held = packed_splats(splats, floor)
    read_back = gsply.sogread(data)
    assert np.allclose(read_back.means, held.means, atol=1e-6)
    assert np.allclose(np.exp(read_back.scales), held.scales, rtol=1e-5)
    turned = np.sign((read_back.quats * held.quats).sum(1))[:, None]
    assert np.allclose(read_back.quats * turned, held.quats, atol=1e-6)
    assert np.allclose(1 / (1 + np.exp(-read_back.opacities)), held.opacities, atol=1e-5)
    assert np.allclose(read_back.sh0, held.harmonics[:, 0], atol=1e-6)
    rest = held.harmonics[:, 1:]
    assert (
        np.allclose(read_back.shN, rest, atol=1e-6)
        if rest.size
        else read_back.shN is None or not read_back.shN.size
    )
    near(held, splats)


def near(held: Splats, splats: Splats) -> None:
    """Compare with the intended values, within the steps of the format."""
    step = np.ptp(np.sign(splats.means) * np.log1p(np.abs(splats.means)), axis=0) / 65535
    assert (np.abs(held.means - splats.means) <= 0.501 * step * (1 + np.abs(splats.means)) + 1e-6).all()
    assert np.abs(np.log(held.scales / splats.scales)).max() < 0.05
    assert (np.abs((held.quats * splats.quats).sum(1)) > 0.9999).all()
    assert np.abs(held.opacities - splats.opacities).max() <= 0.5 / 255 + 1e-5


def test_light_of_18_stops_keeps_its_stops(made: Path) -> None:
    splats, floor = splats_of(made)
    _, held = packed_splats(splats, floor)
    light = np.log2(splats.light[splats.light > 0])
    assert np.ptp(light) > 17
    off = stops_between(splats.light, held.light, floor / splats.factor)
    assert np.median(off) < 0.02
    assert off.max() < 0.2


@needs_splat_transform
@pytest.mark.parametrize("name", ["made", "made_sky", "made_shiny"])
def test_playcanvas_reads_the_gaussians_that_were_written(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    splats, floor = splats_of(request.getfixturevalue(name))
    data, held = packed_splats(splats, floor)
    (tmp_path / "scene.sog").write_bytes(data)
    splat_transform(tmp_path / "scene.sog", tmp_path / "back.ply")
    file = read_ply(tmp_path / "back.ply")
    read_back = as_splats(file, splats.world, splats.offset, linear=True, factor=splats.factor)
    near(read_back, splats)
    assert np.allclose(read_back.harmonics, held.harmonics, rtol=1e-6, atol=1e-6)
    off = stops_between(splats.light, read_back.light, floor / splats.factor)
    assert np.median(off) < 0.02
    assert off.max() < 0.2


def test_one_gaussian_and_a_lamp_of_2_to_the_40(made: Path) -> None:
    splats, floor = splats_of(made)
    bright = splats.rows(np.arange(2))
    bright.harmonics[1] *= 2.0**40
    for few in (splats.rows(np.arange(1)), bright):
        data, held = packed_splats(few, floor)
        read_back = gsply.sogread(data)
        assert np.allclose(read_back.sh0, few.harmonics[:, 0], rtol=1e-4)
        assert np.allclose(read_back.means, few.means, rtol=1e-3)
        assert held.light.max() == pytest.approx(few.light.max(), rel=1e-4)


def test_the_same_scene_gives_the_same_bytes(made: Path) -> None:
    splats, floor = splats_of(made)
    assert packed_splats(splats, floor)[0] == packed_splats(replace(splats), floor)[0]


def test_a_codebook_is_no_worse_than_even_steps() -> None:
    values = np.random.default_rng(0).normal(0, 1, 5000) ** 3
    book = codebook(values)
    assert book.shape == (SIZE,)
    assert (np.diff(book) >= 0).all()
    off = np.abs(book[nearest(values, book)] - values)
    even = np.linspace(values.min(), values.max(), SIZE)
    assert np.square(off).mean() < 0.3 * np.square(even[nearest(values, even)] - values).mean()


def test_a_palette_of_many_is_near_to_them(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("MOST", 5000), ("_SIZE", 500), ("_SAMPLE", 5000)):
        monkeypatch.setattr(choice, name, value)
    rng = np.random.default_rng(0)
    centres = rng.normal(0, 1, (50, 3))
    vectors = centres[rng.integers(0, 50, 5001)] + rng.normal(0, 1e-3, (5001, 3))
    entries, labels = palette(vectors)
    assert len(entries) == 500
    assert np.abs(entries[labels] - vectors).max() < 0.02
