"""A scene on disk is a thing of its own: it renders anywhere, and its own photographs measure it."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from imaging.errors import InputError, ReconstructionError
from imaging.files import store
from imaging.files.exr.reading import read_exr
from imaging.session.luminance import LuminanceReading, LuminanceScale, ReadingEvidence
from imaging.session.view_id import ViewId
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.rendering.render import render
from recon.result.opened import open_model
from recon.result.scene import Scene, open_scene

SMALL = Quality(20, 300, 32)


@pytest.fixture(scope="module")
def draft():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", SMALL)
        yield


def with_scale(session: Path) -> None:
    """Add the scale of a spot meter: light of 1 is 250 +- 10 cd/m2."""
    path = session / "calibration" / "calibration.json"
    record = json.loads(path.read_text())
    reading = LuminanceReading(view="0000/cam0", area=(1, 1, 9, 9), luminance=50.0, error=0.04, source="spot")
    evidence = ReadingEvidence(
        reading=reading, views=(ViewId(0, "cam0"),), luminance=50.0, light=0.2, light_error=0.01,
        shots_sha256="", residual=0.0,
    )  # fmt: skip
    cameras = [camera["name"] for camera in record["cameras"]]
    scale = LuminanceScale(value=250.0, error=10.0, cameras=cameras, readings=(evidence,))
    path.write_text(json.dumps(record | {"luminance": scale.model_dump(mode="json")}))


@pytest.fixture(scope="module")
def trained(toy, tmp_path_factory, draft) -> Path:
    """Scene from RAW, with its poses corrected, and a scale of light; not to be changed."""
    session = shutil.copytree(toy, tmp_path_factory.mktemp("scene") / "session")
    with_scale(session)
    overrides = Overrides(refine="poses+exposures+vignetting")
    return reconstruct(session, TrainingRequest(quality="draft", overrides=overrides))


@pytest.fixture
def scene(trained, tmp_path) -> Path:
    """One that a test may change, in its session."""
    session = shutil.copytree(trained.parent.parent, tmp_path / "session")
    return session / "reconstructions" / trained.name


def pictures(folder: Path, out: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in render(folder, out)}


def test_a_scale_of_light_is_in_all_that_holds_light(trained: Path, tmp_path: Path) -> None:
    scene = open_scene(trained)
    assert (scene.luminance_scale, scene.luminance_error) == (250.0, 10.0)
    for file in render(trained, tmp_path, views=[scene.views[0].name]):
        if file.suffix == ".exr":
            header = read_exr(file).attributes
            values = header["whiteLuminance"], header["rig:whiteLuminanceError"]
            assert np.multiply(values, scene.exposure) == pytest.approx([250.0, 10.0])
    ply = (trained / "radiance.ply").read_bytes().partition(b"end_header")[0].decode()
    (line,) = (line for line in ply.splitlines() if "whiteLuminance" in line)
    assert float(line.split()[2].rstrip(":")) == pytest.approx(250.0 * scene.record.normaliser, rel=1e-5)


def recalibrate(session: Path) -> None:
    """Another calibration of the same photographs: longer lenses, moved cameras, one view fewer."""
    path = session / "calibration" / "calibration.json"
    record = json.loads(path.read_text())
    for camera in record["cameras"]:
        camera["lens"]["fx"] *= 1.3
    for view in record["views"]:
        view["cam_from_world"]["translation"][2] += 0.5
    record["views"] = record["views"][1:]
    path.write_text(json.dumps(record))


@pytest.mark.parametrize("method", ["auto", "vanilla"])
def test_a_copied_folder_renders_the_same_bytes_without_its_session(
    toy, toy_ldr, tmp_path, method, scene, draft
):
    if method == "vanilla":  # display values have a response instead of a factor
        session = shutil.copytree(toy_ldr, tmp_path / "ldr")
        scene = reconstruct(session, TrainingRequest(quality="draft", method="vanilla"))
    opened = open_model(scene)
    limits = opened.scene.renderer.limits
    assert limits == opened.training.renderer().limits
    assert (limits.luminance_reference is None) == (method == "vanilla")
    before = pictures(scene, tmp_path / "before")
    assert len(before) == 12
    moved = shutil.copytree(scene, tmp_path / "elsewhere" / "sent")
    shutil.rmtree(scene.parent.parent)
    assert pictures(moved, tmp_path / "after") == before


def test_a_scene_renders_and_measures_the_same_after_its_session_was_calibrated_again(scene, tmp_path):
    before, figures = pictures(scene, tmp_path / "before"), evaluate(scene)
    recalibrate(scene.parent.parent)
    assert pictures(scene, tmp_path / "after") == before
    again = evaluate(scene)
    assert again.model_copy(update={"render_fps": figures.render_fps}) == figures


def test_the_record_has_the_views_as_training_corrected_them(trained):
    opened = open_model(trained)
    views = open_scene(trained).views
    assert [view.name for view in views] == [view.name for view in opened.dataset.views]
    assert {view.name for view in views if view.use == "test"} == {
        view.name for view in opened.dataset.held_out
    }
    calibrated = {view.id: view for view in opened.dataset.calibration.views}
    for recorded, view in zip(views, opened.dataset.views, strict=True):
        camera = recorded.splat_camera
        assert (
            np.abs(opened.dataset.world.camera(camera).cam_from_world - view.lens.cam_from_world).max()
            < 1e-12
        )
        assert (camera.lens, camera.width, camera.height) == (view.lens.lens, 32, 24)
        assert [shot.k for shot in recorded.shots] == [shot.k for shot in view.shots]
        uncorrected = calibrated[recorded.id].cam_from_world.matrix()
        assert np.allclose(camera.cam_from_world, uncorrected, atol=1e-9) == (recorded.use != "training")


def test_a_view_of_the_data_set_is_drawn_where_the_scene_has_it(scene):
    opened = open_model(scene)
    for view in opened.dataset.views:
        image = opened.render(view.lens).numpy() * opened.record.normaliser
        assert np.allclose(opened.radiance(view), image, rtol=1e-4, atol=1e-4 * image.max())


def test_a_pose_that_no_camera_had_is_rendered_in_linear_light(trained, tmp_path):
    scene = open_scene(str(trained))
    camera = scene.view("0000/cam0").splat_camera
    ahead = np.eye(4)
    ahead[2, 3] = -0.05
    novel = replace(camera, cam_from_world=ahead @ camera.cam_from_world, width=40, cx=20.0)
    image = scene.render(novel)
    assert (image.shape, image.dtype) == ((24, 40, 3), np.float32)
    rendered = scene.render(camera)
    assert np.abs(np.log2(np.median(image) / np.median(rendered))) < 0.5
    assert not np.array_equal(image[:, 4:36], rendered)
    (file, _) = render(trained, tmp_path, views=["0000/cam0"])
    written = read_exr(file)
    np.testing.assert_allclose(written.rgb(), rendered * scene.exposure, rtol=1e-6)
    assert written.attributes["rig:exposureFactor"] == pytest.approx(scene.exposure, rel=1e-6)
    assert "relative to camera signal" in written.attributes["rig:units"]


def test_a_small_picture_is_as_bright_as_a_large_one(trained: Path) -> None:
    scene = open_scene(trained)
    camera = scene.views[0].splat_camera
    sizes = {name: getattr(camera, name) / 8 for name in ("fx", "fy", "cx", "cy")}
    small = replace(camera, width=camera.width // 8, height=camera.height // 8, **sizes)
    usual = replace(scene, renderer=replace(scene.renderer, sampling=None))
    np.testing.assert_allclose(usual.render(camera).mean(), scene.render(camera).mean(), rtol=0.01)
    truth = scene.render(camera).reshape(small.height, 8, small.width, 8, 3).mean((1, 3))
    ours, theirs = (np.abs(one.render(small) - truth).mean() / truth.mean() for one in (scene, usual))
    assert ours < 0.8 * theirs


def test_the_way_up_is_that_of_level_cameras_that_look_down_from_one_side() -> None:
    """The mean of what is up in their pictures leans towards what they look at."""
    views = []
    for heading in np.radians(range(0, 181, 15)):
        right, ahead = (
            np.array([np.sin(heading), -np.cos(heading)]),
            np.array([np.cos(heading), np.sin(heading)]),
        )
        down = np.radians(35)
        motion = np.eye(4)
        motion[:3, :3] = [
            (*right, 0),
            (*(-np.sin(down) * ahead), -np.cos(down)),
            (*(np.cos(down) * ahead), -np.sin(down)),
        ]
        views.append(SimpleNamespace(upright=motion))
    np.testing.assert_allclose(Scene.up.fget(SimpleNamespace(views=views)), (0, 0, 1), atol=1e-2)
    np.testing.assert_array_equal(Scene.up.fget(SimpleNamespace(views=())), (0, -1, 0))


def test_the_exposure_shows_the_median_of_the_scene_as_middle_grey(trained):
    scene = open_scene(trained)
    light = np.concatenate([scene.render(view.splat_camera).ravel() for view in scene.views])
    assert abs(np.log2(np.median(light[light > 0]) * scene.exposure / 0.18)) < 0.3


def test_without_its_photographs_a_scene_is_not_measured_and_the_sentence_says_why(scene, tmp_path):
    session = scene.parent.parent
    moved = shutil.copytree(scene, tmp_path / "reconstructions" / "moved")
    with pytest.raises(ReconstructionError, match=r"is not in its session.*`rig render` works without"):
        evaluate(moved)
    other = shutil.copytree(session, tmp_path / "other")
    lines = (other / "shots.jsonl").read_text().splitlines()
    changed = json.loads(lines[0]) | {"sha256": "0" * 64}
    (other / "shots.jsonl").write_text("\n".join([json.dumps(changed), *lines[1:]]) + "\n")
    with pytest.raises(ReconstructionError, match="does not have the photographs"):
        evaluate(other / "reconstructions" / scene.name)
    file = open_scene(scene).views[-1].shots[0].file
    (session / file).unlink()
    with pytest.raises(ReconstructionError, match=f"{file} is missing"):
        evaluate(scene)
    assert not (scene / "metrics.json").exists()


def test_photographs_that_came_later_do_not_count(scene):
    """A shot more of a bracket, which the scene was not trained on."""
    figures, path = evaluate(scene), scene.parent.parent / "shots.jsonl"
    first = json.loads(path.read_text().splitlines()[0])
    store.append_line(path, first | {"plan": "later"})
    assert evaluate(scene).views == figures.views


def test_fields_that_a_record_does_not_have_are_refused(scene):
    path = scene / "model.json"
    record = json.loads(path.read_text())
    for change in ({"colour": 1}, {"views": [record["views"][0] | {"near": 1.0}]}):
        path.write_text(json.dumps(record | change))
        with pytest.raises(InputError, match=r"model.json: .*extra inputs"):
            open_scene(scene)
