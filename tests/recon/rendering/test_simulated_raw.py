"""RAW of a scene that was never shot, read by LibRaw: its light, its noise and its filters."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import rawpy

from imaging.errors import InputError
from imaging.files import store
from imaging.files.raw import read_raw
from imaging.session.falloff import falloff
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.rendering.render import render
from recon.rendering.simulated_raw import RawCamera
from recon.result.model import read_own_calibration
from recon.result.scene import open_scene


@pytest.fixture(scope="module")
def trained(toy: Path, tmp_path_factory) -> Path:
    """A scene of RAW brackets, as good as not trained; not to be changed."""
    session = shutil.copytree(toy, tmp_path_factory.mktemp("raw") / "session")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(2, 300, 64))
        return Path(reconstruct(session, TrainingRequest(quality="draft")))


def test_a_view_as_its_own_camera_would_record_it(trained: Path, tmp_path: Path) -> None:
    scene = open_scene(trained)
    view = scene.views[0]
    files = [
        path
        for path in render(trained, tmp_path, views=[view.name], raw=view.camera)
        if path.suffix == ".dng"
    ]
    assert [path.name for path in files] == [f"0000_{view.camera}_{step}.dng" for step in range(3)]
    camera = read_own_calibration(trained).camera(view.camera)
    light = scene.render(view) @ np.array(camera.camera_from_rec709).T
    height, width = light.shape[:2]
    letters = np.tile([["RGBW".find(site) for site in row] for row in view.cfa], (height // 2, width // 2))
    filtered = np.take_along_axis(light, letters[..., None], axis=2)[..., 0] * falloff(camera, height, width)
    for path, shot in zip(files, view.shots, strict=True):
        with rawpy.imread(str(path)) as raw:
            codes = raw.raw_image.astype(float)
            black, white = raw.black_level_per_channel[0], raw.white_level
            colours = np.where(raw.raw_colors == 3, 1, raw.raw_colors)  # LibRaw counts the second green apart
            np.testing.assert_array_equal(colours, letters)
        signal = (codes - black) / (65535 - black)
        expected, (slope, floor) = filtered * shot.k, shot.noise
        lit = expected < 0.9 * (white - black) / (65535 - black)
        z = (signal - expected)[lit] / np.sqrt(slope * expected + floor)[lit]
        assert abs(z.mean()) < 5 / np.sqrt(lit.sum())
        assert z.std() == pytest.approx(1, abs=0.06)
        assert (codes[expected > 1.2] == white).all()
        mosaic = read_raw(path)
        assert mosaic.noise_profile == pytest.approx(shot.noise)
        assert mosaic.metadata.exposure.scale == pytest.approx(shot.k, rel=1e-4)
        assert np.allclose(mosaic.camera_from_rec709, camera.camera_from_rec709, atol=1e-4)


def test_noise_is_another_in_another_picture_and_the_same_again(trained: Path) -> None:
    scene = open_scene(trained)
    camera = RawCamera.of(scene, scene.views[0].camera)
    light = np.full((24, 32, 3), 5.0, np.float32)
    one, again, other = (next(camera.bracket(light, seed)).pixels for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert (one != other).mean() > 0.9


@pytest.mark.parametrize("light", [0.0, -1.0, 3e38, float("inf")])
def test_any_light_becomes_codes(trained: Path, light: float) -> None:
    scene = open_scene(trained)
    camera = RawCamera.of(scene, scene.views[0].camera)
    for mosaic in camera.bracket(np.full((24, 32, 3), light, np.float32), 0):
        assert mosaic.pixels.max() <= mosaic.white
        assert (mosaic.pixels.mean() > 60000) == (light > 1)


def test_a_camera_that_is_not_known_is_refused(trained: Path, toy_ldr: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no camera 'other': name one of cam0, cam1"):
        render(trained, tmp_path, raw="other")
    scene = open_scene(trained)
    views = tuple(view.model_copy(update={"cfa": ()}) for view in scene.views)
    scene.record.__dict__["views"] = views
    with pytest.raises(InputError, match="does not say how camera cam0 records RAW"):
        RawCamera.of(scene, "cam0")


def test_a_scene_without_mosaics_is_refused_by_its_record(trained: Path, tmp_path: Path) -> None:
    """Its Gaussians are not read, which takes longer."""
    scene = shutil.copytree(trained, tmp_path / "scene")
    record = store.read_json(scene / "model.json")
    store.write_json(scene / "model.json", record | {"views": [v | {"cfa": []} for v in record["views"]]})
    (scene / "checkpoint.safetensors").unlink()
    with pytest.raises(InputError, match="does not say how camera cam0 records RAW"):
        render(scene, tmp_path / "out", raw="cam0")


def test_a_file_of_splats_is_refused_for_raw(trained: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a file of splats, which do not say how a camera records RAW"):
        render(trained / "splats.ply", tmp_path, raw="cam0")
