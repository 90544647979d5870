"""Every command on everything that can be wrong: one sentence, exit 2 (3 if done in part), nothing left.

The matrix is (what is wrong) x (every command that can meet it). Each case runs in a folder of its
own, whose every file is compared before and after.
"""

import errno
import json
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from imaging.errors import PartialError
from imaging.files import store
from imaging.files.photo import encode_jpeg
from imaging.session.view_id import ViewId

from .refusals import EVERY, assert_one_sentence, assert_refused, fill


@pytest.mark.parametrize("name", EVERY)
def test_a_missing_folder(rig, tmp_path: Path, name: str) -> None:
    it = tmp_path / "nowhere"
    assert str(it) in assert_refused(rig, fill(EVERY[name], it, tmp_path / "out"), tmp_path)


@pytest.mark.parametrize("name", EVERY)
def test_an_empty_folder(rig, tmp_path: Path, name: str) -> None:
    it = tmp_path / "empty"
    it.mkdir()
    assert str(it) in assert_refused(rig, fill(EVERY[name], it, tmp_path / "out"), tmp_path)


@pytest.mark.parametrize("name", EVERY)
def test_a_file_in_place_of_a_folder(rig, tmp_path: Path, name: str) -> None:
    it = tmp_path / "file"
    it.write_text("not a folder")
    assert str(it) in assert_refused(rig, fill(EVERY[name], it, tmp_path / "out"), tmp_path)


@pytest.mark.parametrize("arguments", [["demo", "{it}"], ["capture", "--sim", "toy", "{it}"]])
def test_a_target_that_holds_something_else(rig, tmp_path: Path, arguments: list[str]) -> None:
    it = tmp_path / "photos"
    it.mkdir()
    (it / "holiday.jpg").write_bytes(b"precious")
    assert_refused(rig, fill(arguments, it, it), tmp_path)


@pytest.mark.parametrize("arguments", [["demo", "{it}"], ["capture", "--sim", "toy", "{it}"]])
def test_a_target_that_is_a_file(rig, tmp_path: Path, arguments: list[str]) -> None:
    it = tmp_path / "file"
    it.write_bytes(b"precious")
    assert_refused(rig, fill(arguments, it, it), tmp_path)


WITH_RIG_FILE = {
    "capture": ["capture", "{it}", "{out}", "--sim", "toy"],
    "darks": ["capture", "{it}", "{out}", "--sim", "toy", "--darks"],
    "dry run": ["capture", "{it}", "{out}", "--sim", "toy", "--dry-run"],
}


@pytest.mark.parametrize("name", WITH_RIG_FILE)
@pytest.mark.parametrize(
    "content",
    [b"", b"\xff\xfe[", b"[[camera]]\n", b"x = " + b"[" * 9999, b"# \x00\n", b"a\x1b[2Jb"],
    ids=["empty", "UTF-16", "no name", "nested", "NUL", "escape"],
)
def test_a_rig_file_that_is_none(rig, tmp_path: Path, name: str, content: bytes) -> None:
    it = tmp_path / "RIG.toml"
    it.write_bytes(content)
    assert str(it) in assert_refused(rig, fill(WITH_RIG_FILE[name], it, tmp_path / "out"), tmp_path)


@pytest.mark.parametrize("name", WITH_RIG_FILE)
def test_a_rig_file_that_is_a_folder_or_missing(rig, tmp_path: Path, name: str) -> None:
    for it in (tmp_path, tmp_path / "none.toml"):
        assert str(it) in assert_refused(rig, fill(WITH_RIG_FILE[name], it, tmp_path / "out"), tmp_path)


def test_a_rig_file_that_cannot_be_written(rig, tmp_path: Path, refusing: int) -> None:
    err = assert_refused(rig, ["init", str(tmp_path / "RIG.toml"), "--sim", "toy"], tmp_path)
    assert os.strerror(refusing).lower() in err


def test_a_target_of_an_import_inside_the_photos(rig, tmp_path: Path) -> None:
    photograph(tmp_path / "a.jpg")
    assert_refused(rig, ["import", str(tmp_path), str(tmp_path / "S")], tmp_path)


def photograph(path: Path, seed: int = 0, size: int = 160) -> None:
    """A JPEG of blobs of several sizes: texture, but nothing in common with another seed."""
    rng = np.random.default_rng(seed)
    layers = [
        cv2.GaussianBlur(rng.normal(size=(size, size, 3)), (0, 0), blur) * blur for blur in (1, 2, 4, 8)
    ]
    pixels = np.clip(128 + 90 * sum(layers), 0, 255)
    path.write_bytes(encode_jpeg(pixels.astype(np.uint8), quality=95))


@pytest.fixture
def one_image(rig, tmp_path: Path) -> Path:
    """A session of one photograph."""
    (tmp_path / "photos").mkdir()
    photograph(tmp_path / "photos" / "one.jpg")
    code, _, err = rig("import", str(tmp_path / "photos"), str(tmp_path / "S"))
    assert (code, err) == (0, "")
    return tmp_path / "S"


@pytest.mark.parametrize("name", ["calibrate", "reconstruct", "evaluate", "render"])
def test_one_image_is_too_few(rig, one_image: Path, tmp_path: Path, name: str) -> None:
    assert_refused(rig, fill(EVERY[name], one_image, tmp_path / "out"), tmp_path)


def test_one_image_is_a_sound_session(rig, one_image: Path) -> None:
    code, _, err = rig("check", str(one_image))
    assert (code, err) == (0, "")


@pytest.fixture
def strangers(rig, tmp_path: Path) -> Path:
    """A session of photographs that have nothing in common."""
    (tmp_path / "photos").mkdir()
    for seed in range(3):
        photograph(tmp_path / "photos" / f"{seed}.jpg", seed)
    code, _, err = rig("import", str(tmp_path / "photos"), str(tmp_path / "S"))
    assert (code, err) == (0, "")
    return tmp_path / "S"


@pytest.mark.parametrize("name", ["calibrate", "reconstruct", "evaluate", "render"])
def test_images_without_overlap(rig, strangers: Path, tmp_path: Path, name: str) -> None:
    assert_refused(rig, fill(EVERY[name], strangers, tmp_path / "out"), tmp_path)


def test_some_images_without_a_pose_are_listed_and_the_rest_stays(
    rig, toy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expect exit 3 for what calibration leaves out. SfM itself is made to say so: 64x48 pixels are too
    few.
    """
    from imaging.session.calibration import read_calibration

    record = read_calibration(toy)
    partial = record.model_copy(update={"views": record.views[1:], "unregistered": (ViewId(0, "cam0"),)})
    monkeypatch.setattr("calib.calibrate.calibrate", lambda session, request, **options: partial)
    code, out, err = rig("calibrate", str(toy), "--json")
    assert code == 3
    assert_one_sentence(err)
    assert "0000/cam0" in err
    assert json.loads(out)["unregistered"] == ["0000/cam0"]
    assert json.loads(out)["missing"] in err


def test_a_calibration_in_part_has_its_page(rig, toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def in_part(session: Path, request: object, **options: object) -> None:
        raise PartialError(f"{session}: the response is measured, but no view has a pose: take more views.")

    monkeypatch.setattr("calib.calibrate.calibrate", in_part)
    code, out, err = rig("calibrate", str(toy))
    assert (code, out) == (3, "")
    assert_one_sentence(err)
    assert (toy / "calibration" / "report.html").is_file()


@pytest.mark.parametrize("name", ["reconstruct"])
def test_a_session_that_is_not_calibrated(rig, toy: Path, tmp_path: Path, name: str) -> None:
    shutil.rmtree(toy / "calibration")
    err = assert_refused(rig, fill(EVERY[name], toy, tmp_path / "out"), tmp_path)
    assert f"{toy} is not calibrated: run `rig calibrate {toy}` first" in err


@pytest.mark.parametrize(
    ("unregistered", "words"),
    [((), "run `rig calibrate` in full"), (("0000/cam0", "0000/cam1"), "found none for its 2 images")],
)
def test_a_calibration_without_poses_says_what_there_is_to_do(
    rig, toy: Path, tmp_path: Path, unregistered: tuple[str, ...], words: str
) -> None:
    path = toy / "calibration" / "calibration.json"
    store.write_json(path, store.read_json(path) | {"views": [], "unregistered": unregistered})
    assert words in assert_refused(rig, fill(EVERY["reconstruct"], toy, tmp_path / "out"), tmp_path)


@pytest.mark.parametrize(
    ("number", "fix"),
    [
        (errno.ENOSPC, "free some space"),
        (errno.EROFS, "a disk that can be written to"),
        (errno.EACCES, "change its permissions"),
        (errno.EEXIST, "a file is in its place"),
    ],
)
def test_a_refusal_names_the_fix_of_its_own_reason(number: int, fix: str) -> None:
    message = str(store.refused(Path("S"), OSError(number, os.strerror(number))))
    assert fix in message
    assert message.endswith(".")


@pytest.fixture(params=[errno.EROFS, errno.ENOSPC, errno.EACCES], ids=["EROFS", "ENOSPC", "EACCES"])
def refusing(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Makes the disk refuse every write of `imaging.files.store`: root ignores the permissions of files."""
    number: int = request.param

    def refuse(path: object, *arguments: object, **options: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    for name in ("mkdir", "write_bytes", "replace", "rename"):
        monkeypatch.setattr(Path, name, refuse)
    monkeypatch.setattr(store, "sync", refuse)
    monkeypatch.setattr(os, "fsync", refuse)
    return number


WRITING = {
    "evaluate": ["evaluate", "{it}"],
    "render": ["render", "{it}", "--out", "{out}"],
    "trade": ["trade", "{it}", "--budget", "60s"],
    "demo": ["demo", "{out}"],
    "capture": ["capture", "--sim", "toy", "{out}"],
    "import": ["import", "{it}/raw/0000", "{out}"],
    "calibrate": ["calibrate", "{it}"],
    "reconstruct": ["reconstruct", "{it}", "--quality", "draft"],
}


@pytest.mark.parametrize("name", WRITING)
def test_a_target_that_cannot_be_written(rig, scene: Path, tmp_path: Path, refusing: int, name: str) -> None:
    if name == "reconstruct":
        shutil.rmtree(scene / "reconstructions")
    err = assert_refused(rig, fill(WRITING[name], scene, tmp_path / "out"), tmp_path)
    if name != "calibrate":  # whose 64x48 pixels are refused before anything is to be written
        assert os.strerror(refusing).lower() in err
