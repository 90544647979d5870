"""Depth maps imported with photographs: kept byte for byte, with the unit that is told, or refused."""

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.check.check import check, repair
from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.session.session import Session

POSE = np.eye(4).tolist()


@pytest.fixture
def photos(tmp_path) -> Path:
    folder = tmp_path / "photos"
    (folder / "depth").mkdir(parents=True)
    for number in range(3):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((12, 16, 3), 60 + number, np.uint8))
    cv2.imwrite(str(folder / "depth" / "0.png"), np.full((12, 16), 1500, np.uint16))
    np.save(folder / "depth" / "1.npy", np.full((6, 8), 1.5, np.float32))
    return folder


def layout(folder: Path, keys: list[dict], **top) -> None:
    frames = [{"file_path": f"{n}.png", "transform_matrix": POSE} | more for n, more in enumerate(keys)]
    value = {"w": 16, "h": 12, "fl_x": 20.0, "frames": frames} | top
    (folder / "transforms.json").write_text(json.dumps(value))


def shots(session: Path) -> dict[str, object]:
    return {Path(str(shot.source)).name: shot for shot in Session.open(session).shots()}


def test_depth_file_path_of_nerfstudio(photos, tmp_path):
    named = [{"depth_file_path": "depth/0.png"}, {"depth_file_path": "depth/1.npy"}, {}]
    layout(photos, named)
    result = import_photos(photos, tmp_path / "S")
    by_name = shots(tmp_path / "S")
    for name, original, unit in (("0.png", "depth/0.png", 1e-3), ("1.png", "depth/1.npy", 1.0)):
        data = (photos / original).read_bytes()
        assert by_name[name].depth.startswith("depths/")
        assert (tmp_path / "S" / by_name[name].depth).read_bytes() == data
        assert by_name[name].depth_sha256 == hashlib.sha256(data).hexdigest()
        assert by_name[name].depth_unit == unit
    assert by_name["2.png"].depth is None
    assert any("2 of 3 photos have a depth map, whole numbers in millimetres" in g for g in result.guesses)


def test_depth_path_and_unit_of_instant_ngp(photos, tmp_path):
    layout(
        photos, [{"depth_path": "depth/0.png"}, {"depth_path": "depth/1.npy"}, {}], integer_depth_scale=4e-4
    )
    result = import_photos(photos, tmp_path / "S")
    by_name = shots(tmp_path / "S")
    assert by_name["0.png"].depth_unit == 4e-4
    assert by_name["1.png"].depth_unit == 1.0
    assert any("whole numbers in 0.0004 units of the poses, as stated" in guess for guess in result.guesses)


def test_a_folder_of_depths_beside_the_photos(photos, tmp_path):
    (photos / "depth").rename(tmp_path / "depth")
    import_photos(photos, tmp_path / "S", depths=tmp_path / "depth")
    assert [shot.depth_unit for shot in shots(tmp_path / "S").values()] == [1e-3, 1.0, None]
    assert '"depth"' not in (tmp_path / "S" / "shots.jsonl").read_text().splitlines()[2]


@pytest.mark.parametrize(
    ("key", "top", "said"),
    [
        (
            {"depth_file_path": "depth/9.png"},
            {},
            r"frame 0 .* depth_file_path 'depth/9.png' that is not a file",
        ),
        ({"depth_file_path": "../x.png"}, {}, r"outside|leads out|lies out"),
        ({"depth_file_path": 7}, {}, "depth_file_path 7 that is not a file"),
        ({"depth_file_path": "0.png"}, {}, "is a picture of 8 bits"),
        ({"depth_file_path": "depth/0.png"}, {"integer_depth_scale": 0}, "integer_depth_scale of 0: correct"),
        ({"depth_file_path": "depth/0.png"}, {"integer_depth_scale": "mm"}, "that is not a finite number"),
        ({"depth_file_path": "depth/wide.npy"}, {}, "has 16x6 pixels and its photograph 16x12"),
        ({"depth_file_path": "depth/cut.npy"}, {}, "is damaged"),
    ],
)
def test_what_cannot_be_depth_is_refused_and_leaves_nothing(photos, tmp_path, key, top, said):
    cv2.imwrite(str(tmp_path / "x.png"), np.ones((12, 16), np.uint16))
    np.save(photos / "depth" / "wide.npy", np.ones((6, 16)))
    (photos / "depth" / "cut.npy").write_bytes((photos / "depth" / "1.npy").read_bytes()[:-3])
    layout(photos, [key, {}, {}], **top)
    with pytest.raises(InputError, match=said) as error:
        import_photos(photos, tmp_path / "S")
    assert "\n" not in str(error.value)
    assert not (tmp_path / "S").exists() or not any((tmp_path / "S").iterdir())


def test_check_finds_depth_maps_that_are_gone_or_changed_and_repair_finds_them_again(photos, tmp_path):
    layout(photos, [{"depth_file_path": "depth/0.png"}, {}, {}])
    session = tmp_path / "S"
    import_photos(photos, session)
    assert check(session).problems == ()
    path = session / shots(session)["0.png"].depth
    data = path.read_bytes()
    cv2.imwrite(str(path), np.full((12, 16), 9, np.uint16))
    (problem,) = check(session).problems
    assert (problem.kind, problem.file) == ("altered", path.relative_to(session).as_posix())
    path.unlink()
    (problem,) = check(session).problems
    assert problem.kind == "absent"
    assert "the depth map of raw/" in problem.message
    path.write_bytes(data)
    (session / "shots.jsonl").unlink()
    assert len(repair(session).added) == 3
    assert [shot.depth_unit for shot in Session.open(session).shots()] == [1e-3, None, None]


def test_no_path_of_a_record_leads_out_of_the_session(photos, tmp_path):
    layout(photos, [{"depth_file_path": "depth/0.png"}, {}, {}])
    import_photos(photos, tmp_path / "S")
    session = Session.open(tmp_path / "S")
    shot = next(shot for shot in session.shots() if shot.depth)
    with pytest.raises(InputError):
        session.depth(shot.model_copy(update={"depth": "../photos/depth/0.png"}))
