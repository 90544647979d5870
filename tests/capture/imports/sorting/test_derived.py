"""Pictures among photographs that are none: smaller copies, masks, thumbnails, screenshots."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.imports.photos import import_photos
from capture.imports.sorting import derived
from capture.pictures.read import is_without_tones
from imaging.files.photo import Photo, encode_jpeg, encode_png, read_photo
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.session import Session
from tests.capture.imports.photo_files import put

SAID = FrameMetadata(make="Acme", model="Z1", exposure=Exposure(time=0.01))


def scene(seed: int, size=(96, 64), metadata=None) -> bytes:
    """JPEG of smooth cells, the same at every size."""
    cells = np.random.default_rng(seed).integers(20, 235, (8, 12, 3)).astype(np.uint8)
    return encode_jpeg(cv2.resize(cells, size, interpolation=cv2.INTER_CUBIC), metadata=metadata)


def names_of(session: Path) -> list[str]:
    return [
        Path(one.source).parent.name + "/" + Path(one.source).name for one in Session.open(session).shots()
    ]


@pytest.mark.parametrize("home", ["images_{}", "thumbs", "small/of/all", "exported-{}"])
def test_smaller_copies_are_no_photographs_whatever_their_folder_is_called(tmp_path, home):
    whole = {f"images/{n}.jpg": scene(n) for n in range(4)}
    copies = {f"{home.format(k)}/{n}.jpg": scene(n, (96 // k, 64 // k)) for k in (2, 4) for n in range(4)}
    result = import_photos(put(tmp_path / "in", whole | copies), tmp_path / "s")
    assert (result.cameras, result.frames) == (1, 4)
    assert names_of(tmp_path / "s") == [f"images/{n}.jpg" for n in range(4)]
    assert any("left aside as made of the photographs by another program" in one for one in result.guesses)


def test_a_second_camera_of_fewer_pixels_and_the_same_names_is_no_copy(tmp_path):
    wide = {f"wide/{n}.jpg": scene(n) for n in range(4)}
    narrow = {f"narrow/{n}.jpg": scene(n + 50, (48, 32)) for n in range(4)}
    assert import_photos(put(tmp_path / "in", wide | narrow), tmp_path / "s").shots == 8


@pytest.mark.parametrize(("sizes", "most"), [([(96, 64)], 0), ([(96, 64), (48, 32)], 2 * 6 * 2)])
def test_of_a_folder_for_each_view_a_photo_is_decoded_once_at_most(tmp_path, monkeypatch, sizes, most):
    decoded = []

    def counted(path: Path) -> Photo:
        decoded.append(path)
        return read_photo(path)

    monkeypatch.setattr(derived, "read_photo", counted)
    files = {
        f"{size[0]}/view{view}/{step}.jpg": scene(view, size)
        for size in sizes
        for view in range(6)
        for step in range(2)
    }
    paths = sorted(put(tmp_path / "in", files).rglob("*.jpg"))
    aside = derived.find_derived(tmp_path / "in", paths).aside
    assert sum(len(group) for group in aside.values()) == 12 * (len(sizes) - 1)
    assert len(decoded) == len(set(decoded)) <= most


def test_copies_alone_are_the_photographs(tmp_path):
    files = {f"images_4/{n}.jpg": scene(n, (48, 32)) for n in range(4)}
    assert import_photos(put(tmp_path / "in", files), tmp_path / "s").shots == 4


@pytest.mark.parametrize("name", ["{}.png", "{}.jpg.png"])
@pytest.mark.parametrize("folder", ["masks", "mask"])
def test_a_folder_of_masks_holds_masks(tmp_path, name, folder):
    masks = {f"{folder}/{name.format(n)}": encode_png(np.full((64, 96), 255, np.uint8)) for n in range(4)}
    result = import_photos(
        put(tmp_path / "in", masks | {f"images/{n}.jpg": scene(n) for n in range(4)}), tmp_path / "s"
    )
    assert (result.cameras, result.shots) == (1, 4)
    assert all(one.mask is not None for one in Session.open(tmp_path / "s").shots())
    assert "4 of 4 photos have a mask; what is black in it is ignored." in result.guesses


@pytest.mark.parametrize("home", ["{cam}/masks", "masks/{cam}"])
@pytest.mark.parametrize("photos", ["{cam}", "images/{cam}", "{cam}/images"])
def test_masks_of_a_camera_are_those_of_its_own_photographs(tmp_path, home, photos):
    files = {}
    for value, cam in enumerate(("cam0", "cam1")):
        for n in range(3):
            files[f"{photos.format(cam=cam)}/v.{n}.jpg"] = scene(10 * value + n)
            mask = encode_png(np.full((64, 96), 255 * value + (-n if value else n), np.uint8))
            files[f"{home.format(cam=cam)}/v.{n}.png"] = mask
    import_photos(put(tmp_path / "in", files), tmp_path / "s")
    session = Session.open(tmp_path / "s")
    shots = session.shots()
    assert len(shots) == 6
    for shot in shots:
        source = Path(shot.source)
        cam = next(part for part in source.parts if part.startswith("cam"))
        assert session.mask(shot).read_bytes() == files[f"{home.format(cam=cam)}/{source.stem}.png"]


def test_a_mask_that_may_be_of_several_photographs_is_of_none(tmp_path):
    """Of two photographs 0 neither is nearer to its mask; there is one 1, and one 2."""
    names = ("cam0/0.jpg", "cam1/0.jpg", "cam0/1.jpg", "cam1/2.jpg")
    files = {name: scene(number) for number, name in enumerate(names)}
    files |= {f"masks/{n}.png": encode_png(np.full((64, 96), n, np.uint8)) for n in range(3)}
    result = import_photos(put(tmp_path / "in", files), tmp_path / "s")
    masked = [Path(shot.source).name for shot in Session.open(tmp_path / "s").shots() if shot.mask]
    assert sorted(masked) == ["1.jpg", "2.jpg"]
    assert any(guess.startswith("3 files are left aside") for guess in result.guesses)


def test_a_server_s_thumbnails_are_no_photographs(tmp_path):
    files = {"a.jpg": scene(0), "@eaDir/a.jpg/SYNOPHOTO_THUMB_XL.jpg": scene(0, (48, 32))}
    assert import_photos(put(tmp_path / "in", files), tmp_path / "s").shots == 1


def test_a_stray_screenshot_is_left_aside_by_name_unless_somebody_says_what_cameras_are(tmp_path):
    said = FrameMetadata(make="Acme", model="Z1", exposure=Exposure(time=0.01))
    files = {f"{n}.jpg": scene(n, metadata=said) for n in range(6)} | {"shot.png": scene(9, (40, 90))}
    result = import_photos(put(tmp_path / "in", files), tmp_path / "s")
    assert (result.cameras, result.shots) == (1, 6)
    assert any("left aside" in guess and "shot.png" in guess for guess in result.guesses)
    assert import_photos(tmp_path / "in", tmp_path / "t", cameras="serial").shots == 7
    put(tmp_path / "in", {"edited.jpg": scene(8)})
    assert import_photos(tmp_path / "in", tmp_path / "u").shots == 7


@pytest.mark.parametrize("copy", ["thumb_{}.jpg", "{}-30x20.JPG", "{}_small.png"])
def test_small_copies_beside_their_photographs_are_left_aside(tmp_path, copy):
    files = {f"DSC_{n}.JPG": scene(n, (96, 64), SAID) for n in range(4)}
    put(tmp_path / "in", files | {copy.format(f"DSC_{n}"): scene(n, (30, 20)) for n in range(2)})
    result = import_photos(tmp_path / "in", tmp_path / "s")
    assert (result.cameras, result.shots) == (1, 4)
    names = ", ".join(sorted(copy.format(f"DSC_{n}") for n in range(2)))
    assert f"2 files are left aside as copies of others: {names}." in result.guesses


def test_small_pictures_with_exif_or_of_something_else_are_photographs(tmp_path):
    files = {f"{n}.jpg": scene(n, (96, 64), SAID) for n in range(4)}
    files |= {"0_small.jpg": scene(0, (30, 20), SAID), "1_small.jpg": scene(9, (30, 20))}
    assert import_photos(put(tmp_path / "in", files), tmp_path / "s").shots == 6


COPIES = ["DSC_1 (copy).JPG", "Copy of DSC_1.JPG", "DSC_1copy.JPG", "DSC_1.jpeg", "dsc_1.jpg", "garden-9.JPG"]


@pytest.mark.parametrize("name", COPIES)
def test_the_same_bytes_count_once_in_a_folder_by_the_shortest_name(tmp_path, name):
    files = {f"DSC_{n}.JPG": scene(n, metadata=SAID) for n in range(3)}
    put(tmp_path / "in", files | {name: files["DSC_1.JPG"]})
    result = import_photos(tmp_path / "in", tmp_path / "s")
    assert f"1 file is left aside as a copy of another: {name}." in result.guesses
    assert names_of(tmp_path / "s") == [f"in/DSC_{n}.JPG" for n in range(3)]
    cameras = put(tmp_path / "rig", {"a/0.jpg": scene(0), "b/0.jpg": scene(0)})
    assert import_photos(cameras, tmp_path / "t").shots == 2


def test_the_same_bytes_in_another_folder_count_once_for_a_camera_that_they_name(tmp_path):
    files = {f"DSC_{n}.JPG": scene(n, metadata=SAID) for n in range(3)}
    put(
        tmp_path / "in",
        files | {"best/DSC_1.JPG": files["DSC_1.JPG"], "best/DSC_9.JPG": scene(9, metadata=SAID)},
    )
    result = import_photos(tmp_path / "in", tmp_path / "s")
    assert "1 file is left aside as a copy of another: best/DSC_1.JPG." in result.guesses
    assert names_of(tmp_path / "s") == ["in/DSC_0.JPG", "in/DSC_1.JPG", "in/DSC_2.JPG", "best/DSC_9.JPG"]
    assert any(guess.startswith("4 photos are of the camera") for guess in result.guesses)
    assert import_photos(tmp_path / "in", tmp_path / "t", cameras="folder").shots == 5


def disc() -> np.ndarray:
    """A fisheye's circle, white on black."""
    y, x = np.mgrid[:64, :96]
    return np.where((np.hypot(x - 48, y - 32) < 30)[..., None], 255, np.zeros(3)).astype(np.uint8)


@pytest.mark.parametrize(
    ("flat", "place"),
    [(np.zeros((64, 96, 3), np.uint8), 0), (np.full((64, 96, 3), 255, np.uint8), 2), (disc(), 2)],
)
def test_black_or_white_exposures_of_several_views_are_no_copies(tmp_path, flat, place):
    times = (1 / 4000, 1 / 30, 4.0)
    files = {
        f"v{view}_{step}.jpg": encode_jpeg(flat, metadata=FrameMetadata(exposure=Exposure(time=time)))
        if step == place
        else scene(3 * view + step, metadata=FrameMetadata(exposure=Exposure(time=time)))
        for view in range(3)
        for step, time in enumerate(times)
    }
    result = import_photos(put(tmp_path / "in", files), tmp_path / "s")
    assert (result.frames, result.shots) == (3, 9)
    assert not any("copies" in guess for guess in result.guesses)


def test_black_exposures_of_one_bracket_are_no_copies_and_decoded_once(tmp_path, monkeypatch):
    black, read = encode_jpeg(np.zeros((64, 96, 3), np.uint8)), []
    monkeypatch.setattr(derived, "is_without_tones", lambda path: read.append(path) or is_without_tones(path))
    files = {f"a{step}.jpg": black for step in ("", "_1", "_2")} | {"a_3.jpg": scene(3)}
    assert import_photos(put(tmp_path / "in", files), tmp_path / "s").shots == 4
    assert len(read) == 1


@pytest.mark.parametrize("option", [False, True])
def test_a_file_that_a_list_of_exposures_names_is_no_copy(tmp_path, option):
    black = encode_png(np.zeros((64, 96, 3), np.uint8))
    files = {"v.png": black, "v_1.png": black, "v_2.png": encode_png(np.full((64, 96, 3), 90, np.uint8))}
    put(tmp_path / "in", files)
    home = tmp_path if option else tmp_path / "in"
    (home / "image_list.txt").write_text("v.png, 0.001\nv_1.png, 0.002\nv_2.png, 0.1\n")
    listed = home / "image_list.txt" if option else None
    assert import_photos(tmp_path / "in", tmp_path / "s", exposures=listed).shots == 3
