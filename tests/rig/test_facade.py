"""Functions of `import rig` that no stage has by itself: scenes and sessions as values, cameras,
notebooks.
"""

import base64
import re
import shutil
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

import rig
from imaging.colour.spaces import srgb_encode
from tests.rig.report.pages import Page


@pytest.fixture(scope="module")
def opened(scene_template: Path) -> rig.Scene:
    return rig.open_scene(scene_template)


def pictures(html: str) -> list[Image.Image]:
    data = re.findall(r'src="data:image/(?:png|jpeg);base64,([^"]+)"', html)
    return [Image.open(BytesIO(base64.b64decode(part))) for part in data]


def test_reconstruct_opens_the_scene_that_is_there_and_its_settings_are_those_of_set(toy: Path) -> None:
    settings = {"iterations": 20, "gaussians": 300, "width": 32, "refine": "none", "environment": False}
    said: list[tuple[str, int, int]] = []
    scene = rig.reconstruct(
        rig.Session.open(toy),
        quality="draft",
        settings=settings,
        on_progress=lambda message, done, total: said.append((message, done, total)),
    )
    assert scene.record.iterations == 20
    assert len(scene.gaussians) <= 300
    assert scene.views[0].lens.width == 32
    assert scene.folder.parent == toy / "reconstructions"
    assert any(total > 0 and done == total for _, done, total in said)
    again = rig.reconstruct(toy, quality="draft", settings=settings)
    assert again.record == scene.record


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"settings": {"iteration": 5}}, "settings has no 'iteration'"),
        ({"settings": {"iterations": "many"}}, "iterations='many' cannot be used"),
        ({"settings": ["iterations"]}, "cannot take ['iterations'] for settings: give it a mapping"),
        ({"budget": [1]}, "cannot take [1] for budget: give it seconds"),
        ({"quality": "fine"}, "cannot take 'fine' for quality: give it one of 'draft'"),
        ({"method": "nerf"}, "cannot take 'nerf' for method"),
    ],
)
def test_what_cannot_be_trained_is_refused_before_anything_is_read(options, words, tmp_path: Path) -> None:
    with pytest.raises(rig.InputError, match=re.escape(words)):
        rig.reconstruct(tmp_path / "nosuch", **options)


def test_a_scene_and_a_session_stand_where_their_folders_do(scene: Path) -> None:
    opened, session = rig.open_scene(scene), rig.Session.open(scene)
    assert rig.open_scene(session).folder == opened.folder
    assert rig.evaluate(opened).views == rig.evaluate(session).views != ()
    assert rig.check(session).shots == len(session.shots())
    assert Path(opened) == opened.folder


def test_a_camera_is_a_view_its_name_or_a_camera_of_ones_own(opened: rig.Scene) -> None:
    view = opened.views[1]
    light = opened.render(view.splat_camera)
    assert light.dtype == np.float32
    assert np.array_equal(opened.render(view), light)
    assert np.array_equal(opened.render(view.name), light)
    with pytest.raises(rig.RigError, match="has no view '9999/cam0'"):
        opened.render("9999/cam0")


@pytest.mark.parametrize("stops", [-3.0, 0.0, 2.5])
def test_a_display_picture_is_the_light_at_that_exposure(opened: rig.Scene, stops: float) -> None:
    picture = np.asarray(opened.at(stops, "0001/cam0"), np.float64)
    light = opened.render("0001/cam0").astype(np.float64)
    expected = 255 * srgb_encode(np.clip(light * opened.exposure * 2.0**stops, 0, 1))
    assert picture.shape == light.shape
    assert np.abs(picture - expected).max() <= 0.51


@pytest.mark.filterwarnings("error")
def test_exposures_at_the_ends_are_white_and_black_and_one_that_is_none_is_refused(opened: rig.Scene) -> None:
    bright, dark = (np.asarray(opened.at(stops)) for stops in (5000.0, -5000.0))
    lit = opened.render(opened.views[0]) > 0
    assert (bright[lit] == 255).all()
    assert (dark == 0).all()
    with pytest.raises(rig.RigError, match="cannot be shown at nan stops"):
        opened.at(float("nan"))


def test_a_notebook_shows_the_scene_at_three_exposures_and_what_it_is(opened: rig.Scene) -> None:
    html = opened._repr_html_()
    dark, middle, bright = (np.asarray(one, np.float64) for one in pictures(html))
    view = opened.views[len(opened.views) // 2]
    assert np.array_equal(middle, np.asarray(opened.at(0, view)))
    assert dark.mean() < middle.mean() < bright.mean()
    text = Page(html).text
    assert f"{len(opened.gaussians):,} Gaussians" in text
    assert view.name in text


def test_a_notebook_shows_a_session_as_a_contact_sheet(toy: Path) -> None:
    session = rig.Session.open(toy)
    html = session._repr_html_()
    shots = session.shots("scene")
    views = {shot.view for shot in shots}
    assert f"{len(shots)} shots" in Page(html).text
    assert len(pictures(html)) == min(len(views), 12)
    damaged = session.file(shots[0])
    for shot in shots:
        session.file(shot).write_bytes(b"torn")
    assert damaged.name not in session._repr_html_()
    assert pictures(session._repr_html_()) == []


def test_names_of_folders_are_no_markup(toy: Path, tmp_path: Path) -> None:
    strange = tmp_path / "<script>alert(1)"
    shutil.copytree(toy, strange)
    assert "<script>" not in rig.Session.open(strange)._repr_html_()


def test_cameras_are_found_and_say_what_they_are() -> None:
    cameras = rig.find_cameras("demo")
    assert len(cameras) == 4
    assert all(camera.identity is not None and camera.capabilities is not None for camera in cameras)
    assert len({camera.identity.serial for camera in cameras}) == 4
    with pytest.raises(rig.InputError, match="nosuch"):
        rig.find_cameras("nosuch")


def test_the_guide_does_what_it_says(opened: rig.Scene, scene: Path, tmp_path: Path, monkeypatch) -> None:
    """Its sections on photographs and scenes, line by line."""
    text = (Path(__file__).parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
    section = text.partition("## Photographs as linear light\n")[2].partition("\n## Training\n")[0]
    code = "\n".join(line[4:] for line in section.splitlines() if line.startswith("    ") or not line)
    scene.rename(tmp_path / "S")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"rig": rig, "session": rig.Session.open("S")}
    exec(code, names)
    darker = np.asarray(Image.open("darker.png"))
    assert np.array_equal(darker, np.asarray(opened.at(-2, "0001/cam1")))
    # A camera that rose sees the same place lower in its picture: its centre has moved up, against y.
    before, after = opened.view("0001/cam1").splat_camera.cam_from_world, names["camera"].cam_from_world
    centres = [-motion[:3, :3].T @ motion[:3, 3] for motion in (before, after)]
    np.testing.assert_allclose(centres[1] - centres[0], -0.2 * before[1, :3], atol=1e-12)
    depth = names["mean_depth"]
    assert torch.isfinite(depth).all()
    assert float(depth[names["drawn"].alpha > 0.9].min()) > 0
    np.testing.assert_allclose(names["image"].detach(), opened.render(opened.views[0]), rtol=1e-4, atol=1e-3)
    assert names["gaussians"].parameters["ln_luminance"].grad.abs().sum() > 0
    view = names["session"].views[-1]
    camera = opened.view(view.name).splat_camera
    np.testing.assert_allclose(view.K, camera.K)
    np.testing.assert_allclose(view.world_from_cam, camera.world_from_cam, atol=1e-9)
    np.testing.assert_allclose(names["nerf"] @ np.diag([1, -1, -1, 1]), view.world_from_cam, atol=1e-12)
    truth = rig.read_exr(Path("S") / "truth" / f"{view.name}.exr").rgb()
    lit = names["measured"] & (truth > 0.1 * np.median(truth)).all(-1)
    assert abs(np.median(np.log2(names["light"][lit] / truth[lit]))) < 0.05
    assert (names["sigma"][lit] > 0).all()
