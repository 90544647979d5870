"""Every command on pictures and records that are damaged: one sentence that names the file, nothing left."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from .refusals import EVERY, ON_SESSION, assert_one_sentence, assert_refused, fill, tree


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-500])


def text_instead(path: Path) -> None:
    path.write_text("I am no picture.\n")


def empty_instead(path: Path) -> None:
    path.write_bytes(b"")


DAMAGES: dict[str, Callable[[Path], None]] = {
    "truncated": truncate,
    "text": text_instead,
    "empty": empty_instead,
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_import_of_nothing_but_a_damaged_dng(rig, toy_template: Path, tmp_path: Path, damage: str) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    shutil.copy(toy_template / "raw" / "0000" / "cam0_1.dng", photos / "a.dng")
    DAMAGES[damage](photos / "a.dng")
    assert "a.dng" in assert_refused(rig, ["import", str(photos), str(tmp_path / "S")], tmp_path)


@pytest.mark.parametrize("damage", DAMAGES)
def test_import_of_a_damaged_dng_among_sound_ones(
    rig, toy_template: Path, tmp_path: Path, damage: str
) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    for name in ("a.dng", "b.dng"):
        shutil.copy(toy_template / "raw" / "0000" / "cam0_1.dng", photos / name)
    DAMAGES[damage](photos / "a.dng")
    code, out, err = rig("import", str(photos), str(tmp_path / "S"), "--json")
    assert code == 3
    assert_one_sentence(err)
    assert "a.dng" in err
    assert json.loads(out)["shots"] == 1


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", ["calibrate", "reconstruct", "evaluate"])
def test_a_session_with_a_damaged_dng(rig, scene: Path, tmp_path: Path, name: str, damage: str) -> None:
    DAMAGES[damage](scene / "raw" / "0001" / "cam1_1.dng")
    if name in ("calibrate", "reconstruct"):
        shutil.rmtree(scene / "reconstructions")
    if name == "calibrate":
        shutil.rmtree(scene / "calibration")
    assert "cam1_1.dng" in assert_refused(rig, fill(EVERY[name], scene, tmp_path / "out"), tmp_path)


@pytest.mark.parametrize("damage", DAMAGES)
def test_check_names_a_damaged_dng_and_says_what_is_sound(rig, toy: Path, damage: str) -> None:
    DAMAGES[damage](toy / "raw" / "0001" / "cam1_1.dng")
    before = tree(toy)
    code, out, err = rig("check", str(toy), "--json")
    assert code == 3
    assert_one_sentence(err)
    assert "raw/0001/cam1_1.dng" in err
    assert json.loads(out)["sound"] == 17
    shutil.rmtree(toy / "check")  # its report is all that it writes
    assert tree(toy) == before


DAMAGED_RECORDS = {
    "session.json": ["check", "repair", "calibrate", "reconstruct", "evaluate"],
    "shots.jsonl": ["calibrate", "reconstruct", "evaluate"],
    "calibration/calibration.json": ["reconstruct"],
    "reconstructions/nh-3dgs-draft/calibration.json": ["evaluate"],
    "reconstructions/nh-3dgs-draft/model.json": ["evaluate", "render"],
}


@pytest.mark.parametrize(
    ("file", "name"), [(file, name) for file, names in DAMAGED_RECORDS.items() for name in names]
)
@pytest.mark.parametrize("content", ['{"schema_version": 1, "surprise": true}\n', "not JSON\n"])
def test_a_damaged_record_is_named(
    rig, scene: Path, tmp_path: Path, name: str, file: str, content: str
) -> None:
    (scene / file).write_text(content)
    assert file in assert_refused(rig, fill(EVERY[name], scene, tmp_path / "out"), tmp_path)


def test_a_record_of_a_later_version_says_so(rig, scene: Path, tmp_path: Path) -> None:
    (scene / "session.json").write_text('{"schema_version": 2}\n')
    for name in ON_SESSION.keys() - {"render"}:  # which needs nothing but the scene
        err = assert_refused(rig, fill(ON_SESSION[name], scene, tmp_path / "out"), tmp_path)
        assert "schema version 2" in err


def test_a_damaged_checkpoint_is_named(rig, scene: Path, tmp_path: Path) -> None:
    truncate(scene / "reconstructions" / "nh-3dgs-draft" / "checkpoint.safetensors")
    for name in ("evaluate", "render"):
        err = assert_refused(rig, fill(EVERY[name], scene, tmp_path / "out"), tmp_path)
        assert "checkpoint.safetensors" in err
