"""The hand-over folder: its pictures line up with its cameras, and all of it is in one exposure."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import PyOpenColorIO as OCIO
import pytest
from pxr import Gf, Usd, UsdGeom

from imaging.errors import InputError
from imaging.progress import unreported
from recon.exports.formats import nuke
from recon.exports.hand_over import LINEAR, NAMES, WRITTEN, HandOver, hand_over
from recon.exports.hand_over_page import page
from recon.exports.job import Job
from recon.exports.loss import Loss
from recon.exports.target_coordinates import pinhole, place_of
from recon.result.scene import Scene, open_scene
from tests.rig.report.pages import Page, assert_self_contained


@pytest.fixture(scope="module")
def handed(made_sky: Path, tmp_path_factory: pytest.TempPathFactory) -> HandOver:
    return hand_over(made_sky, tmp_path_factory.mktemp("hand-over") / "vfx", exposure=1.0)


def test_every_file_that_is_told_is_there(handed: HandOver) -> None:
    there = {path for path in handed.folder.rglob("*") if path.is_file()}
    assert {path.name for path in handed.folder.iterdir()} <= WRITTEN
    assert set(handed.files) == there
    assert {"scene.usdc", "scene.environment.exr", "config.ocio", "index.html"} <= {
        path.name for path in there
    }
    assert handed.exposure_factor == 2.0


def test_renders_are_the_light_of_the_scene_as_the_pinholes_of_the_usd_see_it(
    handed: HandOver, made_sky: Path
) -> None:
    scene = open_scene(made_sky)
    for view in scene.views:
        path = handed.folder / "renders" / f"{view.camera}.{view.frame:04d}.exr"
        with OpenEXR.File(str(path), separate_channels=True) as file:
            header, channels = dict(file.header()), file.channels()
            light = np.dstack([channels[name].pixels for name in "RGB"])
        assert np.allclose(light, 2 * scene.render(pinhole(view.splat_camera)), rtol=1e-5)
        assert header["colorInteropID"] == "lin_rec709_scene"
        assert "chromaticities" not in header
        assert header["whiteLuminance"] == pytest.approx(125.0)
    stage = Usd.Stage.Open(str(handed.folder / "scene.usdc"))
    custom = stage.GetRootLayer().customLayerData["rig"]
    assert custom["whiteLuminance"] == pytest.approx(125.0)


def test_a_chan_is_the_camera_of_the_usd(handed: HandOver) -> None:
    """Turned as Nuke does by its order ZXY: z first, then x, then y."""
    stage = Usd.Stage.Open(str(handed.folder / "scene.usdc"))
    for line in (handed.folder / "cameras" / "a-1.chan").read_text().splitlines():
        frame, *place, x, y, z, angle = map(float, line.split())
        camera = UsdGeom.Camera.Get(stage, "/World/Cameras/a_1")
        turn = Gf.Rotation((0, 0, 1), z) * Gf.Rotation((1, 0, 0), x) * Gf.Rotation((0, 1, 0), y)
        made = Gf.Matrix4d(turn, Gf.Vec3d(*place))
        in_stage = camera.ComputeLocalToWorldTransform(frame)
        assert np.allclose(np.array(made), np.array(in_stage), atol=1e-5)
        assert angle == pytest.approx(camera.GetCamera(frame).GetFieldOfView(Gf.Camera.FOVVertical), abs=1e-3)


def test_nodes_of_nuke_have_names_that_nuke_accepts(made_sky: Path) -> None:
    """Cameras need not: a hyphen stays in the names of files alone."""
    text = nuke.script(open_scene(made_sky), ["a-1"])
    assert "renders/a-1.####.exr" in text
    names = re.findall(r"^ name (.*)$", text, re.MULTILINE)
    assert len(set(names)) == len(names) == 6
    assert all(re.fullmatch("[A-Za-z]\\w*", name, re.ASCII) for name in names)


def test_nuke_reads_the_frames_of_each_camera(scene: Scene) -> None:
    """A view that has no pose is no file, and no error at its frame."""
    views = [
        view.model_copy(update={"frame": 4 * view.frame}) if view.camera == "a-1" else view
        for view in scene.views
    ]
    text = nuke.script(
        replace(scene, record=scene.record.model_copy(update={"views": views})), ["a-1", "a.1"]
    )
    asked = dict(re.findall(r"/renders/(.*)\.####\.exr\"\n((?: (?:first|last|on_error) .*\n)+)", text))
    assert asked == {"a-1": " first 0\n last 4\n on_error black\n", "a.1": " first 0\n last 1\n"}


def test_alembic_has_the_cameras_of_the_usd(handed: HandOver) -> None:
    """Alembic's film is in cm, USD's in tenths of a metre here; Alembic has no more frames than there are."""
    alembic3d = pytest.importorskip("alembic3d")
    Abc, AbcGeom = alembic3d.Abc, alembic3d.AbcGeom
    stage = Usd.Stage.Open(str(handed.folder / "scene.usdc"))
    archive = Abc.IArchive(str(handed.folder / "cameras" / "cameras.abc"))
    transform = AbcGeom.IXform(archive.getTop(), "a-1")
    lens = AbcGeom.ICamera(transform, "a-1Shape").getSchema()
    camera = UsdGeom.Camera.Get(stage, "/World/Cameras/a_1")
    times = transform.getSchema().getTimeSampling()
    frames = sorted(UsdGeom.Xformable(camera).GetTimeSamples())
    assert transform.getSchema().getNumSamples() == lens.getNumSamples() == len(frames)
    for number, frame in enumerate(frames):
        assert 24 * times.getSampleTime(number) == pytest.approx(frame)
        at = Abc.ISampleSelector(number)
        made = transform.getSchema().getValue(at).getMatrix()
        assert np.allclose(
            [[made[i][j] for j in range(4)] for i in range(4)],
            np.array(camera.ComputeLocalToWorldTransform(frame)),
            atol=1e-9,
        )
        film, of_usd = lens.getValue(at), camera.GetCamera(frame)
        for value, expected in (
            (film.getFocalLength() / 10, of_usd.focalLength),
            (film.getHorizontalAperture(), of_usd.horizontalAperture),
            (film.getVerticalAperture(), of_usd.verticalAperture),
            (film.getHorizontalFilmOffset(), of_usd.horizontalApertureOffset),
            (film.getVerticalFilmOffset(), of_usd.verticalApertureOffset),
        ):
            assert value == pytest.approx(10 * expected, rel=1e-6, abs=1e-9)
        assert film.getNearClippingPlane() == pytest.approx(of_usd.clippingRange.min)


def test_without_the_library_the_hand_over_says_what_it_lacks(
    made_sky: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "alembic3d", None)
    handed = hand_over(made_sky, tmp_path / "vfx")
    assert not (handed.folder / "cameras" / "cameras.abc").exists()
    assert "cameras as Alembic, which need pip install -e '.[alembic]'" in handed.notes


def test_opencolorio_takes_the_renders_for_linear_rec709(handed: HandOver) -> None:
    config = OCIO.Config.CreateFromFile(str(handed.folder / "config.ocio"))
    config.validate()
    assert config.getColorSpaceFromFilepath("renders/a-1.0000.exr")[0] == LINEAR
    assert config.getColorSpaceFromFilepath("/show/handover/plates/a-1.1001.exr")[0] == LINEAR
    assert config.getColorSpaceFromFilepath("C:\\show\\lenses\\a-1.undistort.exr")[0] == "Raw"
    assert config.getColorSpaceFromFilepath("handover/scene.environment.exr")[0] == LINEAR
    for other in ("somewhere/plate.dpx", "/show/plates/bg.1001.exr", "/show/renders/beauty.1001.exr"):
        assert config.getColorSpaceFromFilepath(other)[0] == "ACES2065-1"
    for name, alias in NAMES.items():
        assert config.getColorSpace(alias).getName() == name


def test_the_page_says_units_and_coordinates(handed: HandOver) -> None:
    page = (handed.folder / "index.html").read_text()
    assert_self_contained(Page.read(handed.folder / "index.html"))
    for words in (
        "metres",
        "EPSG:25832",
        "125 &plusmn; 5 cd/m&sup2;",
        "times 2 (+1.00 stops)",
        "SplatRender",
    ):
        assert words in page


def test_the_page_says_what_blender_needs_of_pictures_that_are_higher_than_wide(scene: Scene) -> None:
    upright = [
        view.model_copy(update={"lens": view.lens.model_copy(update={"width": 48, "height": 64})})
        for view in scene.views
    ]
    assert str(Loss(None, None, 0.01, 0.2, 0.0, 1)) == (
        "0.01 stops in the median and 0.2 in the worst 1 % of a pixel's light"
    )
    assert str(Loss(0.0, 0.0, 0.0, 0.0, 0.0, 1)).endswith(
        " of a Gaussian's light; less than 0.001 stops of a pixel's"
    )
    loss = Loss(None, None, 0.0, 0.0, 0.0, 1)
    for views, there in ((scene.views, False), (upright, True)):
        turned = replace(scene, record=scene.record.model_copy(update={"views": tuple(views)}))
        job = Job(turned, Path("scene.usdc"), True, None, place_of(turned), unreported)
        assert ("Sensor Fit" in page(turned, job, loss, (), ())) == there


def test_a_folder_of_something_else_is_left_alone_and_an_older_one_replaced(
    made: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.txt").touch()
    with pytest.raises(InputError, match="has files already"):
        hand_over(made, other)
    assert [path.name for path in other.iterdir()] == ["thesis.txt"]
    (other / "thesis.txt").rename(other / "index.html")
    with pytest.raises(InputError, match=r"has files already, such as index\.html"):
        hand_over(made, other)
    with pytest.raises(InputError, match="is a file, and a hand-over fills a folder"):
        hand_over(made, other / "index.html")
    assert [path.name for path in other.iterdir()] == ["index.html"]
    hand_over(made, tmp_path / "vfx")
    (tmp_path / "vfx" / "renders" / "old.exr").touch()
    (tmp_path / "link").symlink_to(tmp_path / "vfx")
    again = hand_over(made, tmp_path / "link")
    assert again.folder == tmp_path / "link"
    assert (tmp_path / "link").is_symlink()
    assert all(path.is_file() for path in again.files)
    assert not (tmp_path / "vfx" / "renders" / "old.exr").exists()
    (tmp_path / "vfx" / "comp_v07.nk").touch()
    with pytest.raises(InputError, match=r"has files already, such as comp_v07\.nk"):
        hand_over(made, tmp_path / "link")
    assert (tmp_path / "vfx" / "comp_v07.nk").is_file()
