"""A session before it has a scene, in headless Chromium, against what the simulator showed its cameras."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.files.exr.reading import read_exr
from imaging.files.photo import encode_jpeg
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.paths import without_scene
from imaging.session.view_id import ViewId
from rig.view.pages.rig_model import RigModel
from rig.view.pages.session_page import show_session
from rig.view.pictures.look import Look
from rig.view.pictures.photographs import Photograph, Photographs, in_words, labelled, sheet
from rig.view.serving.server import Viewer


@pytest.fixture(scope="module")
def session(toy_template: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Calibrated, without a scene."""
    folder = tmp_path_factory.mktemp("session") / "toy"
    shutil.copytree(toy_template, folder, ignore=shutil.ignore_patterns("reconstructions"))
    return folder


def test_photographs_are_the_light_that_was_there(session: Path) -> None:
    """The simulator's own; blurred, since the sites of a mosaic's colours lie beside each other."""
    photographs = Photographs(session)
    view = next(iter(photographs.groups))
    light = photographs.read(view).light
    truth = read_exr(session / "truth" / f"{view}.exr").rgb()
    truth = cv2.resize(truth, light.shape[1::-1], interpolation=cv2.INTER_AREA)
    light, truth = (cv2.GaussianBlur(one, (0, 0), 2) for one in (light, truth))
    lit = (truth > 0.2 * np.median(truth)).all(2) & (light > 0).all(2)
    assert lit.mean() > 0.5
    off = np.log2(light[lit] / truth[lit])
    off -= np.median(off[:, 1])
    assert np.median(np.abs(off[:, 1])) < 0.12
    assert np.median(np.abs(off)) < 0.25


def test_photographs_are_upright_as_their_files_state(tmp_path: Path) -> None:
    codes = np.zeros((24, 32, 3), np.uint8)
    codes[:6, :6] = 200
    (tmp_path / "photos").mkdir()
    for number, orientation in enumerate((1, 6)):
        data = encode_jpeg(codes + np.uint8(number), metadata=FrameMetadata(orientation=orientation))
        (tmp_path / "photos" / f"{number}.jpg").write_bytes(data)
    import_photos(tmp_path / "photos", tmp_path / "S")
    photographs = Photographs(tmp_path / "S")
    stored, held = (photographs.read(view).light for view in photographs.groups)
    assert (stored.shape, held.shape) == ((24, 32, 3), (32, 24, 3))
    assert stored[:4, :4].min() > 0.4
    assert held[:4, -4:].min() > 0.4
    as_stated = photographs.read(next(iter(photographs.groups)), 6).light
    np.testing.assert_array_equal(as_stated, stored[::-1].swapaxes(0, 1))


def test_a_rig_of_portraits_stands_upright(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = RigModel.of(Photographs(session))
    monkeypatch.setattr(Photographs, "orientation", lambda photographs, view: 6)
    held = RigModel.of(Photographs(session))
    sideways = -np.sum([pose[0, :3] for pose in rig.poses.values()], axis=0)
    assert held.start().up @ sideways > 0.9 * np.linalg.norm(sideways)
    for view, lens in held.lenses.items():
        np.testing.assert_array_equal(held.start(view).up, held.start().up)
        assert (lens.width, lens.height) == (rig.lenses[view].height, rig.lenses[view].width)


def test_a_sheet_has_every_picture_in_its_place() -> None:
    pictures = [np.full((2, 3, 3), number, np.float32) for number in range(1, 6)]
    tiled = sheet(pictures, 2)
    assert tiled.shape == (6, 6, 3)
    assert tiled[::2, ::3, 0].tolist() == [[1, 2], [3, 4], [5, 0]]


def test_damaged_files_are_told_of(session: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(session, tmp_path / "damaged"))
    photographs = Photographs(folder)
    view, shots = next(iter(photographs.groups.items()))
    (folder / shots[0].file).write_bytes(b"nothing")
    photograph = photographs.read(view)
    assert photograph.light is None
    assert str(view) in photograph.caption
    assert Path(shots[0].file).name in photograph.caption


def test_photographs_are_named_and_said_once_where_they_are_alike() -> None:
    views = [ViewId(frame, f"cam{camera}") for frame in range(2) for camera in range(3)]
    alike = [Photograph(view, None, f"{view}: 1/1000 s to 1/4 s") for view in views]
    assert in_words(alike) == ["all: 1/1000 s to 1/4 s"]
    other = [*alike[:5], Photograph(views[5], None, f"{views[5]}: damaged")]
    assert in_words(other) == [
        "0000/cam0, 0000/cam1, 0000/cam2 and 2 more: 1/1000 s to 1/4 s",
        "0001/cam2: damaged",
    ]
    assert in_words([Photograph(views[0], None, str(views[0]))]) == ["0000/cam0"]
    sheet = np.full((80, 300, 3), 128, np.uint8)
    named = labelled(sheet, [str(view) for view in views], 3)
    for row in (0, 40):
        for column in (0, 100, 200):
            assert named[row : row + 14, column : column + 60].max() > 200
            assert (named[row + 20 : row + 40, column : column + 100] == 128).all()
    assert np.array_equal(labelled(sheet[:8], ["0000/cam0"], 1), sheet[:8])


def test_an_empty_session_is_told(session: Path, tmp_path: Path) -> None:
    (tmp_path / "session.json").write_bytes((session / "session.json").read_bytes())
    assert without_scene(tmp_path)
    with Viewer("toy", 0) as viewer, pytest.raises(InputError, match="no photographs"):
        show_session(viewer, tmp_path)


def test_the_page_has_a_contact_sheet_and_the_rig(session: Path, open_window) -> None:
    with Viewer("toy", 0) as viewer:
        show_session(viewer, session)
        window = open_window(viewer)
        page = window.page
        window.until(lambda: len(page.read) == len(page.photographs))

        def developed(stops: float) -> bool:
            """Return whether the lower half is the sheet, which is a few pixels that the browser enlarges."""
            sheet = page.frame.in_window(Look(stops, "AgX").shown(page.frame.light, page._scale))
            drawn = cv2.resize(window.canvas(), sheet.shape[1::-1], interpolation=cv2.INTER_AREA)
            return bool(np.abs(drawn - sheet)[sheet.shape[0] // 2 :].mean() < 12)

        window.until(lambda: developed(0.0))
        assert not developed(2.0)
        window.tab.locator("input[inputmode=decimal]").fill("2")
        window.tab.keyboard.press("Enter")
        window.until(lambda: developed(2.0))
        window.choose("photographs", "rig")
        window.until(lambda: "residual, px" in page.words.content)
        window.until(lambda: window.canvas()[250:].std() > 4)
        assert window.canvas()[250:].mean() < 100
        window.tab.close()


def test_the_rig_is_seen_in_its_own_size(session: Path) -> None:
    photographs = Photographs(session)
    rig = RigModel.of(photographs)
    centres = [-pose[:3, :3].T @ pose[:3, 3] for pose in rig.poses.values()]
    assert np.abs(np.median(centres, axis=0)).max() < 1e-9
    assert np.median(np.linalg.norm(rig.points, axis=1)) == pytest.approx(1, rel=1e-3)
    assert set(rig.residuals) <= set(rig.poses)
    start = rig.start()
    away = np.subtract(start.look_at, start.position)
    assert np.dot(away, start.up) < 0  # from above
