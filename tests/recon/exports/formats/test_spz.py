"""SPZ files, written here and read by gsply, PlayCanvas and Niantic, and the other way round."""

import json
import shutil
import struct
import subprocess
from base64 import b64decode
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from imaging.errors import InputError
from imaging.progress import unreported
from recon.exports.export import export
from recon.exports.formats.spz import packed_splats
from recon.exports.splats import Splats, as_splats, display_splats
from recon.result.scene import Scene, open_scene
from recon.scene.ply import write_ply
from recon.scene.ply_file import PlySplats, read_ply
from recon.scene.spz import Version, read_spz, unpack
from tests.foreign_gsply import gsply
from tests.foreign_viewers.viewers import MODULES
from tests.splat_transform import needs_splat_transform, splat_transform


@pytest.fixture(scope="module")
def shown(made_shiny: Path) -> Splats:
    """Colours of degree 2, in sRGB."""
    return display_splats(open_scene(made_shiny), None, unreported)


@pytest.mark.parametrize("version", [3, 4])
def test_gsply_reads_what_was_written(shown: Splats, version: Version, tmp_path: Path) -> None:
    data, held = packed_splats(shown, version)
    (tmp_path / "a.spz").write_bytes(data)
    read_back = gsply.read_spz(str(tmp_path / "a.spz"))
    flip = [1, -1, -1]  # gsply keeps the axes of the file
    assert np.allclose(read_back.means, held.means * flip, atol=1e-6)
    assert np.allclose(read_back.scales, np.log(held.scales), atol=1e-5)
    quats = held.quats * [1, 1, -1, -1]
    assert np.allclose(np.abs((read_back.quats * quats).sum(1)), 1, atol=1e-5)
    assert np.allclose(read_back.sh0, held.harmonics[:, 0], atol=1e-5)
    rest = held.harmonics[:, 1:] * np.array([-1, -1, 1, -1, 1, 1, -1, 1])[:, None]
    assert np.allclose(read_back.shN, rest, atol=1e-5)
    # and what is held is near to what was to be written
    assert np.abs(held.means - shown.means).max() < 1e-5
    assert np.abs(np.log(held.scales / shown.scales)).max() <= 1 / 32 + 1e-9
    assert (np.abs((held.quats * shown.quats).sum(1)) > 0.99999).all()
    assert np.abs(held.opacities - shown.opacities).max() <= 0.5 / 255 + 1e-9
    assert np.abs(held.colours - shown.colours.clip(0, 1.4403)).max() < 0.0042


def test_what_gsply_writes_is_read(shown: Splats, tmp_path: Path) -> None:
    path = tmp_path / "theirs.spz"
    values = {
        "means": shown.means,
        "scales": np.log(shown.scales),
        "quats": shown.quats,
        "opacities": shown.logits,
        "sh0": shown.harmonics[:, 0],
        "shN": shown.harmonics[:, 1:],
    }
    single = {name: np.ascontiguousarray(value, np.float32) for name, value in values.items()}
    gsply.write_spz(str(path), gsply.GSData(**single, masks=None, _base=None))
    read_back = read_spz(path)
    assert np.abs(read_back.means * [1, -1, -1] - shown.means).max() < 2e-3  # gsply keeps axes as they are
    near(read_back, shown)


@needs_splat_transform
@pytest.mark.parametrize("version", [3, 4])
def test_playcanvas_reads_what_was_written(shown: Splats, version: Version, tmp_path: Path) -> None:
    data, held = packed_splats(shown, version)
    (tmp_path / "a.spz").write_bytes(data)
    splat_transform(tmp_path / "a.spz", tmp_path / "back.ply")
    file = read_ply(tmp_path / "back.ply")
    read_back = as_splats(file, shown.world, shown.offset, linear=False, factor=shown.factor)
    assert np.allclose(read_back.means, held.means, atol=1e-6)
    assert np.allclose(read_back.scales, held.scales, rtol=1e-5)
    assert np.allclose(np.abs((read_back.quats * held.quats).sum(1)), 1, atol=1e-6)
    assert np.allclose(read_back.opacities, held.opacities, atol=1e-5)
    assert np.allclose(read_back.harmonics, held.harmonics, atol=1e-6)


NIANTIC = MODULES / "@adobe/spz/dist/spz.js"
READ = """
import { readFileSync } from "node:fs";
const [module, file] = process.argv.slice(1);
console.log = () => {};
const spz = await (await import(module)).default();
const cloud = spz.loadSpzFromBuffer(readFileSync(file), { to: spz.CoordinateSystem.RDF });
const fields = ["positions", "scales", "rotations", "alphas", "colors", "sh"];
const bytes = (name) => Buffer.from(new Float32Array(cloud[name]).buffer).toString("base64");
process.stdout.write(JSON.stringify(Object.fromEntries(fields.map((name) => [name, bytes(name)]))));
"""


@pytest.mark.skipif(
    not NIANTIC.is_file() or shutil.which("node") is None,
    reason="npm install --prefix .judges @adobe/spz is not there, or Node",
)
@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("degree", [0, 2])
def test_niantic_reads_what_was_written(shown: Splats, degree: int, version: Version, tmp_path: Path) -> None:
    """Without harmonics there is no stream of them."""
    data, held = packed_splats(replace(shown, harmonics=shown.harmonics[:, : (degree + 1) ** 2]), version)
    (tmp_path / "a.spz").write_bytes(data)
    command = ["node", "--input-type=module", "-e", READ, str(NIANTIC), str(tmp_path / "a.spz")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    read = {name: np.frombuffer(b64decode(text), "<f4") for name, text in json.loads(done.stdout).items()}
    cloud = {name: values.reshape(len(held), -1) for name, values in read.items()}
    assert np.allclose(cloud["positions"], held.means, atol=1e-6)
    assert np.allclose(cloud["scales"], np.log(held.scales), atol=1e-5)
    assert np.allclose(np.abs((cloud["rotations"][:, [3, 0, 1, 2]] * held.quats).sum(1)), 1, atol=1e-6)
    assert np.allclose(expit(cloud["alphas"][:, 0]), held.opacities, atol=2e-6)
    assert np.allclose(np.c_[cloud["colors"], cloud["sh"]], held.harmonics.reshape(len(held), -1), atol=1e-6)


def test_both_versions_have_the_same_numbers(shown: Splats) -> None:
    (third, _), (fourth, _) = (packed_splats(shown, version) for version in (3, 4))
    one, other = unpack(third), unpack(fourth)
    assert struct.unpack("<II", fourth[:8]) == (0x5053474E, 4)
    for name in ("means", "log_scales", "quats", "logits", "harmonics"):
        assert np.array_equal(getattr(one, name), getattr(other, name))


@needs_splat_transform
@pytest.mark.parametrize("version", ["3", "4"])
def test_what_playcanvas_writes_is_read(shown: Splats, version: str, tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", shown.gaussians(), shown.harmonics, [], shown.world, shown.offset)
    splat_transform(tmp_path / "a.ply", tmp_path / "b.spz", "--spz-version", version)
    read_back = read_spz(tmp_path / "b.spz")
    assert np.abs(read_back.means - shown.means).max() < 2e-3
    assert np.abs(read_back.harmonics[:, 1:] - shown.harmonics[:, 1:]).max() < 0.07
    near(read_back, shown)


def near(splats: PlySplats, shown: Splats) -> None:
    assert len(splats) == len(shown)
    assert np.abs(splats.log_scales - np.log(shown.scales)).max() < 0.04
    assert np.abs(splats.harmonics[:, 0] - shown.harmonics[:, 0].clip(-3.33, 3.33)).max() < 0.02


def test_far_and_small_scenes_keep_their_places(shown: Splats) -> None:
    """Twelve bits of fraction would end at 2048 units, and be a quarter of a millimetre at best."""
    for scale in (1e-3, 1e4):
        moved = replace(shown, means=shown.means * scale)
        off = np.abs(packed_splats(moved)[1].means - moved.means).max()
        assert off < 1e-4 * np.ptp(moved.means)


def test_linear_light_is_refused_with_what_it_would_lose(scene: Scene, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"so \d\d % of the linear light .* more than a third of a stop"):
        export(scene, tmp_path / "scene.spz", linear=True)
    assert not list(tmp_path.iterdir())


def test_damaged_files_are_refused_in_a_sentence(shown: Splats, tmp_path: Path) -> None:
    data, _ = packed_splats(shown)
    lies = struct.pack("<IIIBBBBI", 0x5053474E, 4, 2**31, 3, 12, 0, 6, 32) + bytes(200)
    for number, damaged in enumerate((b"", b"NGSP", data[:200], data[:-9], b"\x1f\x8b" + bytes(40), lies)):
        path = tmp_path / f"{number}.spz"
        path.write_bytes(damaged)
        with pytest.raises(InputError, match="is not an SPZ file, or it is damaged"):
            read_spz(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_spz(tmp_path / "none.spz")
