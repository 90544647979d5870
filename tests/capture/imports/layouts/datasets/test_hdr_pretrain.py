"""HDR-Pretrain's layout: brackets, their times and poses, and the true light."""

import json

import numpy as np
import pytest

from capture.imports import layouts
from capture.imports.layouts.datasets import hdr_pretrain
from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.session.calibration import read_calibration
from imaging.session.session import Session, brackets
from recon.data.load import load
from recon.measure.truth import has_truth, true_radiance
from tests.rig.benchmarks.hdr_pretrain_scene import TESTED, TIMES, hdr_pretrain_scene
from tests.rig.benchmarks.painted_wall import CENTRES, light


def test_views_are_brackets_with_times_poses_split_and_light(tmp_path):
    scene = hdr_pretrain_scene(tmp_path / "h")
    assert layouts.detect(scene) == "hdr-pretrain"
    result = import_photos(scene, tmp_path / "s")
    assert (result.layout, result.cameras, result.views, result.shots) == ("hdr-pretrain", 1, 9, 45)
    session = Session.open(tmp_path / "s")
    for group in brackets(session.shots()).values():
        assert [shot.reported.time for shot in group] == list(TIMES)
    assert has_truth(session.folder)
    tested = [CENTRES[number] for number in TESTED]
    poses = {view.id: view.cam_from_world.matrix() for view in read_calibration(session.folder).views}
    dataset = load(session.folder)
    assert (len(dataset.train), len(dataset.held_out)) == (6, 3)
    for view in dataset.views:
        motion = poses[view.id]
        x, y, z = -motion[:3, :3].T @ motion[:3, 3]
        assert z == pytest.approx(0, abs=1e-9)
        assert any(np.allclose([x, y], one) for one in tested) == (view in dataset.held_out)
        np.testing.assert_allclose(true_radiance(session.folder, view), light((x, y)), rtol=1e-5)


def test_a_colmap_project_with_times_of_its_own_stays_one(tmp_path):
    scene = hdr_pretrain_scene(tmp_path / "h")
    for path in (scene / "images").iterdir():
        path.rename(path.with_name(f"IMG_{path.name}"))
    assert layouts.detect(scene) == "colmap"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], "does not give a time"),
        ({"train_ldr_000_0.png": 0}, "not a positive number"),
        ({"train_ldr_000_0.png": True}, "not a positive number"),
        ({"train_ldr_000_0.png": 1.0}, "has no time for"),
    ],
)
def test_damaged_times_are_named(tmp_path, content, message):
    scene = hdr_pretrain_scene(tmp_path / "h")
    (scene / "exposure.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        hdr_pretrain.read(scene)


def test_other_damage_is_named(tmp_path):
    scene = hdr_pretrain_scene(tmp_path / "h")
    photo = scene / "images" / "train_ldr_000_3.png"
    data = photo.read_bytes()
    photo.unlink()
    assert "train_ldr_000_3.png is named in" in hdr_pretrain.read(scene).missing[0]
    (scene / "images" / "notes.png").write_bytes(data)
    with pytest.raises(InputError, match=r"not named train_ldr_000_0 .* use --layout colmap\.$"):
        hdr_pretrain.read(scene)
    (scene / "images" / "notes.png").rename(scene / "images" / "train_ldr_077_0.png")
    with pytest.raises(InputError, match="has no pose for"):
        hdr_pretrain.read(scene)
    for file in (scene / "sparse" / "0").iterdir():
        file.unlink()
    with pytest.raises(InputError, match="no COLMAP model"):
        hdr_pretrain.read(scene)
