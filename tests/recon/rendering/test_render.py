"""Pictures of scenes on disk: what they say of what is transparent."""

import shutil
from pathlib import Path

import cv2
import imagecodecs
import numpy as np
import OpenEXR
import pytest

import recon.reconstruct as stage
from imaging.colour.spaces import srgb_decode
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr.reading import read_exr
from imaging.files.hdr_display import HEADROOM
from imaging.files.photo import encode_png, read_photo
from recon.data.geometry import rays
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.rendering.cameras.camera_paths import named_path
from recon.rendering.render import render, render_probe
from recon.rendering.video import Video
from recon.result.data_layers import DataLayers
from recon.result.display import displayed
from recon.result.layer_names import LAYERS
from recon.result.opened import open_model
from recon.result.scene import open_scene
from tests.recon.rendering.test_hdr_video import decoded


@pytest.fixture(scope="module")
def cut_out(toy_ldr, tmp_path_factory) -> Path:
    """A scene of photographs whose left half is transparent, as PNG; not to be changed."""
    session = shutil.copytree(toy_ldr, tmp_path_factory.mktemp("render") / "session")
    lines = store.read_lines(session / "shots.jsonl")
    store.discard(session / "shots.jsonl")
    for line in lines:
        codes = read_photo(session / line["file"]).pixels
        alpha = np.full(codes.shape[:2], 255, np.uint8)
        alpha[:, : codes.shape[1] // 2] = 0
        store.write_bytes(session / line["file"], encode_png(np.dstack([np.uint8(255 * codes), alpha])))
        line["sha256"] = store.sha256(session / line["file"])
        store.append_line(session / "shots.jsonl", line)
    path = session / "calibration" / "calibration.json"
    record = store.read_json(path) | {"shots_sha256": store.sha256(session / "shots.jsonl")}
    store.write_json(path, record)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(40, 400, 32))
        return stage.reconstruct(session, TrainingRequest(quality="draft", method="vanilla"))


def test_pictures_of_a_cut_out_object_are_layers(cut_out: Path, tmp_path: Path) -> None:
    """EXR premultiplied, PNG straight: over a background both give the same picture."""
    scene = open_scene(cut_out)
    view = scene.views[0]
    light, alpha = scene.layer(view.splat_camera)
    assert alpha is not None
    assert alpha[:, 20:].mean() > 2 * alpha[:, :12].mean()
    exr, png = render(cut_out, tmp_path, views=[view.name])
    planes = read_exr(exr).channels
    np.testing.assert_array_equal(planes["A"], alpha)
    np.testing.assert_array_equal(
        np.dstack([planes[name] for name in "RGB"]), light * np.float32(scene.exposure)
    )
    picture = cv2.cvtColor(cv2.imread(str(png), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA) / 255.0
    np.testing.assert_allclose(picture[..., 3], alpha, atol=0.5 / 255 + 1e-6)
    straight = (light * scene.exposure / np.maximum(alpha, 1 / 255)[..., None]).clip(0, 1)
    np.testing.assert_allclose(srgb_decode(picture[..., :3]), straight, atol=0.01)


def test_light_is_stored_as_asked_and_layers_without_loss(cut_out: Path, tmp_path: Path) -> None:
    view = open_scene(cut_out).views[0].name
    exact = read_exr(render(cut_out, tmp_path / "float", views=[view], layers=("depth",))[0]).channels
    for storage, within in (("half", 2**-11), ("dwaa", 0.05)):
        file = render(cut_out, tmp_path / storage, views=[view], layers=("depth",), exr=storage)[0]
        with OpenEXR.File(str(file), separate_channels=True) as opened:
            light, depth = (part.channels for part in opened.parts)
            assert light["G"].pixels.dtype == np.float16
            assert np.array_equal(depth["Z"].pixels, exact["Z"])
            assert ("DWAA" in str(opened.parts[0].header["compression"])) == (storage == "dwaa")
            off = np.abs(light["G"].pixels - exact["G"])
        bright = exact["G"] > 2**-10
        assert np.median(off[bright] / exact["G"][bright]) <= within
    place = render_probe(cut_out, tmp_path, view, width=32, exr="half")[0]
    with OpenEXR.File(str(place), separate_channels=True) as opened:
        assert opened.parts[0].channels["G"].pixels.dtype == np.float16


def test_photographs_of_a_cut_out_object_are_compared_before_white_too(cut_out: Path) -> None:
    result = evaluate(cut_out)
    opened = open_model(cut_out)
    figures = []
    for view in opened.dataset.reported:
        scene_view = opened.scene.view(view.name)
        alpha = opened.scene.layer(scene_view.splat_camera)[1]
        assert alpha is not None
        for shot in view.shots:
            white = shot.pixels.copy()
            white[:, : white.shape[1] // 2] = 1
            shown = opened.training.method.observation.predict(opened.render(view.lens), view, shot.k).numpy()
            shown = (shown + (1 - alpha)[..., None]).clip(0, 1)
            figures.append(-10 * np.log10(np.square(shown - white)[shot.valid].mean()))
    assert result.ldr_psnr_white == pytest.approx(np.mean(figures), abs=1e-3)
    assert abs(result.ldr_psnr_white - result.ldr_psnr_oe) > 0.1


def test_a_scene_of_whole_photographs_has_no_alpha(toy_ldr: Path, tmp_path: Path) -> None:
    session = shutil.copytree(toy_ldr, tmp_path / "session")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(2, 100, 32))
        folder = stage.reconstruct(session, TrainingRequest(quality="draft", method="vanilla"))
    assert evaluate(folder).ldr_psnr_white is None
    scene = open_scene(folder)
    assert scene.layer(scene.views[0].splat_camera)[1] is None
    exr, png = render(folder, tmp_path / "out", views=[scene.views[0].name])
    assert set(read_exr(exr).channels) == {"R", "G", "B"}
    assert cv2.imread(str(png), cv2.IMREAD_UNCHANGED).shape[2] == 3


def test_pictures_of_any_width_show_the_same_scene(cut_out: Path, tmp_path: Path) -> None:
    name = open_scene(cut_out).views[0].name
    planes = {
        width: read_exr(render(cut_out, tmp_path / str(width), views=[name], width=width)[0]).channels["G"]
        for width in (16, 32, 128)
    }
    assert {width: plane.shape for width, plane in planes.items()} == {
        16: (12, 16),
        32: (24, 32),
        128: (96, 128),
    }
    usual = render(cut_out, tmp_path / "usual", views=[name])[0]
    np.testing.assert_array_equal(read_exr(usual).channels["G"], planes[32])
    for width in (16, 128):
        assert planes[width].mean() == pytest.approx(planes[32].mean(), rel=0.03)


def test_a_film_without_pictures_is_refused_before_the_scene_is_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="need stops"):
        render(tmp_path / "scene", tmp_path / "out", path="spline:3", stops=(), video=True)
    assert not (tmp_path / "out").exists()


def test_a_path_becomes_numbered_files_with_layers_and_a_film(cut_out: Path, tmp_path: Path) -> None:
    reports = []
    files = render(
        cut_out,
        tmp_path,
        path="spline:3",
        first_frame=7,
        width=48,
        space="acescg",
        layers=LAYERS,
        hdr=True,
        video=True,
        rate=12,
        on_progress=lambda what, done, total: reports.append((what, done, total)),
    )
    names = [f"spline.{number:04d}" for number in (7, 8, 9)]
    assert [file.name for file in files] == [
        *(f"{name}.exr" for name in names),
        *(f"{name}.{kind}" for name in names for kind in ("png", "jpg", "avif")),
        "spline.hdr.mp4",
        "spline.hlg.mp4",
        "spline.mp4",
    ]
    assert {path.name for path in tmp_path.iterdir()} == {file.name for file in files}
    assert reports[-1] == ("rendering", 3, 3)
    scene = open_scene(cut_out)
    path = named_path(scene, "spline:3")
    assert path is not None
    camera, data = path.cameras[1].resized(48), DataLayers(scene)
    image = read_exr(files[1])
    assert image.attributes["colorInteropID"] == "lin_ap1_scene"
    light, alpha = scene.layer(camera)
    assert image.rgb() == pytest.approx(light * scene.exposure, rel=1e-4, abs=1e-5)
    with OpenEXR.File(str(files[1]), separate_channels=True, header_only=True) as exr:
        header = dict(exr.parts[0].header)
    assert header["framesPerSecond"] == 12
    assert (header["timeCode"].seconds, header["timeCode"].frame) == (0, 8)
    far = np.array([*scene.views[0].splat_camera.world_from_cam[:3, 3] + camera.world_from_cam[:3, 2], 1.0])
    in_camera = camera.cam_from_world @ far
    x, y, _, w = far @ header["worldToNDC"]
    pixel = camera.K @ in_camera[:3]
    np.testing.assert_allclose([x / w * camera.width, y / w * camera.height], pixel[:2] / pixel[2], rtol=1e-4)
    np.testing.assert_allclose(far @ header["worldToCamera"], [1, -1, 1, 1] * in_camera, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(image.channels["A"], alpha)
    np.testing.assert_array_equal(image.channels["alpha.A"], alpha)
    np.testing.assert_array_equal(image.channels["Z"], data.depth(camera))
    np.testing.assert_array_equal(image.channels["trust"], data.trust(camera))
    normal = np.dstack([image.channels[f"N.{axis}"] for axis in "XYZ"])
    np.testing.assert_array_equal(normal, data.normal(camera))
    bright = imagecodecs.ultrahdr_decode((tmp_path / f"{names[1]}.jpg").read_bytes(), boost=2**HEADROOM)
    assert np.median(np.abs(bright[..., :3] - light * scene.exposure)) < 0.01
    base = cv2.imread(str(tmp_path / f"{names[1]}.jpg"))[..., ::-1].astype(float)
    assert np.abs(base - displayed(light, scene.exposure)).mean() < 1
    shown = decoded(files[-3])[1][1]
    assert shown.shape == light.shape
    assert np.median(np.abs(np.clip(shown, 0, 16) - light.clip(0, 16) * scene.exposure)) < 0.01
    film = cv2.VideoCapture(str(files[-1]))
    assert film.get(cv2.CAP_PROP_FPS) == 12
    for name in names:
        there, shown = film.read()
        assert there
        picture = cv2.imread(str(tmp_path / f"{name}.png"), cv2.IMREAD_UNCHANGED).astype(float)
        before_black = picture[..., :3] * picture[..., 3:] / 255
        assert np.abs(shown - before_black).mean() < 6
    assert not film.read()[0]


def test_frames_of_a_longer_render_are_named_and_stay(cut_out: Path, tmp_path: Path) -> None:
    """Compositors read a sequence to its last number; pieces of one shot are rendered one after the other."""
    earlier = ["orbit.1002.exr", "orbit.1002.png", "orbit.1003_+0.5ev.png", "orbit.1003_0.dng"]
    others = ["orbit.mp4", "orbit.1002.tif", "orbit.1002_a.png", "orbits.1002.exr", "my.orbit.1002.exr"]
    for name in (*earlier, *others):
        (tmp_path / name).write_bytes(b"")
    messages: list[str] = []
    files = render(cut_out, tmp_path, path="orbit:2", first_frame=999, width=16, on_message=messages.append)
    written = [f"orbit.{number}.{kind}" for kind in ("exr", "png") for number in ("0999", "1000")]
    assert [file.name for file in files] == written
    assert {path.name for path in tmp_path.iterdir()} == {*written, *earlier, *others}
    (message,) = messages
    assert "orbit.1002.exr and 3 more files of another render of orbit" in message


def test_a_film_of_odd_sizes_is_even_and_of_two_sizes_refused(tmp_path: Path) -> None:
    grey = np.full((31, 33, 3), 90, np.uint8)
    with Video(tmp_path / "a.mp4", 24) as film:
        film.add(grey)
    there, shown = cv2.VideoCapture(str(tmp_path / "a.mp4")).read()
    assert there
    assert shown.shape == (32, 34, 3)
    assert np.abs(shown.astype(int) - 90).max() <= 3
    film = Video(tmp_path / "b.mp4", 24)
    film.add(grey)
    with pytest.raises(InputError, match="of one size"), film:
        film.add(grey[:20])
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_a_light_probe_stands_where_a_view_did(cut_out: Path, tmp_path: Path) -> None:
    scene = open_scene(cut_out)
    view = scene.views[0]
    exr, png = render_probe(cut_out, tmp_path, view.name, width=64, space="acescg")
    image = read_exr(exr)
    assert image.channels["R"].shape == (32, 64)
    assert cv2.imread(str(png), cv2.IMREAD_UNCHANGED).shape == (32, 64, 4)
    assert image.attributes["colorInteropID"] == "lin_ap1_scene"
    motion = view.cam_from_world.matrix()
    centre = -motion[:3, :3].T @ motion[:3, 3]
    place_of_header = np.array([float(part) for part in str(image.attributes["rig:place"]).split()])
    np.testing.assert_allclose(place_of_header, centre, rtol=1e-6)
    again = render_probe(cut_out, tmp_path / "by place", centre, width=64)[0]
    assert image.rgb() == pytest.approx(read_exr(again).rgb(), rel=1e-3, abs=1e-4)
    # What the map has in the direction of the view's axis is what the view sees there.
    axes = [[float(part) for part in str(image.attributes[f"rig:{name}"]).split()]
            for name in ("longitude90", "up", "middle")]  # fmt: skip
    fine = read_exr(render_probe(cut_out, tmp_path / "fine", centre, width=256, exposure=0)[0]).rgb()
    light = scene.layer(view.splat_camera)[0]
    x, y = np.meshgrid(np.arange(32) + 0.5, np.arange(24) + 0.5)
    ahead = rays(view.splat_camera, np.stack([x, y], -1)) @ motion[:3, :3] @ np.transpose(axes)
    x, y, z = np.moveaxis(ahead / np.linalg.norm(ahead, axis=-1, keepdims=True), -1, 0)
    column = np.float32(256 * (0.5 - np.arctan2(x, z) / (2 * np.pi)) - 0.5)
    row = np.float32(128 * (0.5 - np.arcsin(y) / np.pi) - 0.5)
    there = cv2.remap(fine, column, row, cv2.INTER_LINEAR)
    lit = light.min(axis=-1) > 0.05 * np.median(light)
    logs = [np.log(plane.max(axis=-1)[lit]) for plane in (light, there)]
    assert np.corrcoef(*logs)[0, 1] > 0.95
    assert 0 < image.attributes["rig:known"] < 1


@pytest.mark.parametrize("place", [(1.0, 2.0), (1.0, float("nan"), 3.0)])
def test_a_probe_at_no_place_is_refused(cut_out: Path, tmp_path: Path, place: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="three finite coordinates"):
        render_probe(cut_out, tmp_path, place)
