"""Masks imported with photographs: kept byte for byte, or told why they cannot be used or trusted."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.check.check import check, repair
from capture.imports.given.masks import masks_beside
from capture.imports.photos import import_photos
from capture.pictures.read import read_picture
from imaging.colour.spaces import srgb_encode
from imaging.errors import InputError
from imaging.files.tiff.dng import encode_dng
from imaging.merge.masks import mask_of
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.session import Session
from tests.capture.check.index_lines import lines, write


def picture(path: Path, value: int, size=(16, 12)) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.full((size[1], size[0], 3), value, np.uint8)
    cv2.imwrite(str(path), image)
    return path


def test_transparent_photographs_are_told_and_mask_themselves_if_asked_to(tmp_path):
    rgba = np.full((12, 16, 4), 120, np.uint8)
    rgba[:, :8, 3], rgba[:, 8:, 3] = 0, 255
    for name in ("photos/0.png", "cut/0.png"):
        (tmp_path / name).parent.mkdir()
        cv2.imwrite(str(tmp_path / name), rgba)
    cv2.imwrite(str(tmp_path / "photos" / "1.png"), rgba[..., :3])
    result = import_photos(tmp_path / "photos", tmp_path / "S")
    guesses = [guess for guess in result.guesses if "transparent" in guess]
    (guess,) = guesses
    assert guess.startswith("1 photo is partly transparent: transparent areas stay empty in the scene")
    assert read_picture(tmp_path / "photos" / "0.png").black == 0.5
    masked = import_photos(tmp_path / "photos", tmp_path / "T", masks=tmp_path / "cut")
    assert not any("transparent" in guess for guess in masked.guesses)
    session = Session.open(tmp_path / "T")
    (shot,) = (shot for shot in session.shots() if shot.mask)
    counts = mask_of(session, shot, 12, 16)
    assert counts[:, 8:].all()
    assert not counts[:, :8].any()


@pytest.fixture
def photos(tmp_path) -> Path:
    for number in range(3):
        picture(tmp_path / "photos" / f"{number}.png", 40 + number)
    return tmp_path / "photos"


def test_a_folder_of_masks_is_kept_with_its_photos(photos, tmp_path):
    first, third = picture(tmp_path / "masks" / "0.png", 0), picture(tmp_path / "masks" / "2.png.png", 255)
    result = import_photos(photos, tmp_path / "S", masks=tmp_path / "masks")
    session = Session.open(tmp_path / "S")
    masks = {Path(shot.source).name: shot.mask for shot in session.shots()}
    assert masks["1.png"] is None
    for name, mask in (("0.png", first), ("2.png", third)):
        assert masks[name].startswith("masks/")
        assert (session.folder / masks[name]).read_bytes() == mask.read_bytes()
    assert any("2 of 3 photos have a mask" in guess for guess in result.guesses)


def test_without_masks_the_records_are_as_ever(photos, tmp_path):
    import_photos(photos, tmp_path / "S")
    assert '"mask"' not in (tmp_path / "S" / "shots.jsonl").read_text()


def test_mask_path_of_nerfstudio(photos, tmp_path):
    mask = picture(photos / "masks" / "0.png", 255)
    pose = np.eye(4).tolist()
    frames = [{"file_path": f"{n}.png", "transform_matrix": pose} for n in range(3)]
    frames[0]["mask_path"] = "masks/0.png"
    top = {"w": 16, "h": 12, "fl_x": 20.0, "frames": frames}
    (photos / "transforms.json").write_text(json.dumps(top))
    import_photos(photos, tmp_path / "S")
    session = Session.open(tmp_path / "S")
    shots = {Path(shot.source).name: shot for shot in session.shots()}
    assert len(shots) == 3
    assert (session.folder / shots["0.png"].mask).read_bytes() == mask.read_bytes()
    assert shots["1.png"].mask is None
    frames[1]["mask_path"] = "masks/1.png"
    (photos / "transforms.json").write_text(json.dumps(top))
    with pytest.raises(InputError, match=r"frame 1 .* has a mask_path 'masks/1.png' that is not a file"):
        import_photos(photos, tmp_path / "T")


def test_names_of_masks(tmp_path):
    """COLMAP's `b.jpg.png`, and plain `b.png`; the first counts where both are there."""
    root, masks = tmp_path / "images", tmp_path / "masks"
    paths = [root / "a" / f"{n}.jpg" for n in range(3)]
    colmap = picture(masks / "a" / "0.jpg.png", 0)
    picture(masks / "a" / "0.png", 0)
    plain = picture(masks / "a" / "1.png", 0)
    assert masks_beside(paths, root, masks) == {paths[0]: colmap, paths[1]: plain}


def test_masks_that_cannot_be_used(photos, tmp_path, monkeypatch):
    picture(tmp_path / "small" / "1.png", 0, (8, 6))
    with pytest.raises(InputError, match="has 8x6 pixels and its photograph 16x12: make it of the same size"):
        import_photos(photos, tmp_path / "S", masks=tmp_path / "small")
    assert not (tmp_path / "S").exists() or not any((tmp_path / "S").iterdir())
    picture(tmp_path / "other" / "x.png", 0)
    with pytest.raises(
        InputError, match=r"holds no mask of any photo: name them as the photos, such as 0\.png"
    ):
        import_photos(photos, tmp_path / "S", masks=tmp_path / "other")
    with pytest.raises(InputError, match="nothing is not a folder"):
        import_photos(photos, tmp_path / "S", masks=tmp_path / "nothing")
    picture(photos / "covers" / "0.png", 0)
    with pytest.raises(InputError, match="is inside the folder of photographs"):
        import_photos(photos, tmp_path / "S", masks=photos / "covers")
    with pytest.raises(
        InputError, match="itself: copy the masks to a folder outside of it and name that one"
    ):
        import_photos(photos, tmp_path / "S", masks=photos)
    monkeypatch.chdir(photos.parent)
    with pytest.raises(InputError, match="is inside the folder of photographs"):
        import_photos(photos.name, tmp_path / "S", masks=photos / "covers")


@pytest.fixture
def session(photos, tmp_path) -> Session:
    """Three photographs, of which the first has a mask."""
    picture(tmp_path / "masks" / "0.png", 0)
    import_photos(photos, tmp_path / "S", masks=tmp_path / "masks")
    return Session.open(tmp_path / "S")


def mask_problems(session: Session) -> list[tuple[str, str]]:
    report = check(session.folder)
    assert report.sound == 3
    return [(problem.kind, problem.message) for problem in report.problems]


def test_a_sound_mask_is_no_finding_and_another_is_named(session):
    first = next(shot for shot in session.shots() if shot.mask)
    path = session.mask(first)
    assert mask_problems(session) == []
    picture(path, 255)
    ((kind, message),) = mask_problems(session)
    assert kind == "altered"
    assert message == (
        f"{first.mask}, the mask of {first.file}, is not the file that was recorded (its SHA-256 differs): "
        "restore it from a copy, or import the photographs again."
    )
    path.unlink()
    ((kind, message),) = mask_problems(session)
    assert kind == "absent"
    assert f"{first.mask}, the mask of {first.file}, is missing" in message


def test_masks_of_sessions_without_their_digests_are_read(session):
    records = lines(session)
    (masked,) = (record for record in records if "mask" in record)
    del masked["mask_sha256"]
    write(session, records)
    assert mask_problems(session) == []
    (session.folder / masked["mask"]).write_bytes(b"nothing")
    ((kind, message),) = mask_problems(session)
    assert kind == "torn"
    assert "is not a JPEG, PNG or TIFF file" in message
    masked["mask"] = "../masks/0.png"
    write(session, records)
    ((kind, message),) = mask_problems(session)
    assert "leads out of" in message


def test_a_repair_finds_the_mask_of_a_shot_again(session):
    records = lines(session)
    (masked,) = (record for record in records if "mask" in record)
    write(session, [record for record in records if record is not masked])
    assert repair(session.folder).added == (masked["file"],)
    (shot,) = (shot for shot in session.shots() if shot.mask)
    assert (shot.file, shot.mask, shot.mask_sha256) == (masked["file"], masked["mask"], masked["mask_sha256"])
    write(session, [record for record in records if record is not masked])
    (session.folder / masked["mask"]).write_bytes(b"nothing")
    (reason,) = repair(session.folder).unrepaired
    assert "is not a JPEG, PNG or TIFF file" in reason


@pytest.mark.parametrize("kind", ["png", "dng"])
def test_what_moves_behind_a_mask_is_no_motion_and_no_exposure(kind, tmp_path):
    """Half of the picture is another in each of three exposures; behind masks nothing is said of it."""
    rng = np.random.default_rng(3)

    def scene() -> np.ndarray:
        coarse = rng.uniform(-3.5, 0.5, (10, 16)).astype(np.float32)
        fine = rng.standard_normal((60, 80)).astype(np.float32)
        both = (cv2.resize(one, (320, 240), interpolation=cv2.INTER_CUBIC) for one in (coarse, fine))
        return np.exp(next(both) + 0.1 * next(both))

    still, hidden = scene(), np.zeros((240, 320), bool)
    hidden[48:192, 64:304] = True
    (tmp_path / "photos").mkdir()
    for step, time in enumerate((0.5, 0.125, 0.03125)):
        light = np.where(hidden, scene(), still) * time * 2 + 0.002 * rng.standard_normal(hidden.shape)
        path = tmp_path / "photos" / f"a{step}.{kind}"
        if kind == "png":
            code = np.rint(255 * srgb_encode(np.clip(light, 0, 1))).astype(np.uint8)
            cv2.imwrite(str(path), code[..., None].repeat(3, 2))
        else:
            pixels = np.rint(64 + 4031 * np.clip(light, 0, 1)).astype(np.uint16)
            metadata = FrameMetadata(exposure=Exposure(time=time))
            path.write_bytes(encode_dng(RawMosaic(pixels, Cfa.RGGB, ((64.0,),), 4095, metadata=metadata)))
        cover = tmp_path / "masks" / f"a{step}.png"
        cover.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(cover), 255 * np.uint8(~hidden))
    if kind == "png":
        names = "".join(f"a{step}.png {2 * 4**step} 4 0 0\n" for step in range(3))
        (tmp_path / "photos" / "image_list.txt").write_text(names)
    looks = {}
    for name, masks in (("masked", tmp_path / "masks"), ("bare", None)):
        import_photos(tmp_path / "photos", tmp_path / name, masks=masks)
        looks[name] = check(tmp_path / name).looks
    for look in looks["masked"]:
        assert look.moved is None or look.moved < 0.02
        assert look.off is not None
        assert abs(look.off) < 0.02
    assert sum(look.moved is not None for look in looks["masked"]) == 2
    assert max(look.moved or 0.0 for look in looks["bare"]) > 0.2
