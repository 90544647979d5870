"""`rig check --repair` gives files the names back that its records give them, and overwrites none."""

import json
from pathlib import Path

import numpy as np
import pytest

from capture.check.check import check, repair
from imaging.errors import InputError
from imaging.files import store
from imaging.files.photo import encode_jpeg
from imaging.session.records import ShotRecord
from tests.trees import tree

from .index_lines import lines, write


def test_files_that_were_renamed_or_swapped_get_their_names_back(rig):
    folder = rig.session.folder
    before, index = tree(folder / "raw"), (folder / "shots.jsonl").read_bytes()
    one, two, three = (folder / f"raw/0000/{name}" for name in ("a_0.dng", "b_1.jpg", "a_2.dng"))
    one.rename(folder / "raw/0001/foo.dng")
    two.rename(folder / "raw/0000/hold")
    (folder / "raw/0002/b_1.jpg").rename(two)
    (folder / "raw/0000/hold").rename(folder / "raw/0002/b_1.jpg")
    three.rename(folder / "raw/0000/a_2.dng.back")  # as a repair leaves it that is killed
    done = repair(folder)
    assert (done.dropped, done.added, done.unrepaired, done.backup) == ((), (), (), None)
    assert "raw/0001/foo.dng is raw/0000/a_0.dng, and is called so again" in done.renamed
    assert len(done.renamed) == 4
    assert (tree(folder / "raw"), (folder / "shots.jsonl").read_bytes()) == (before, index)
    assert check(folder).ok


def test_no_file_is_overwritten_by_one_that_gets_its_name_back(rig):
    folder = rig.session.folder
    (folder / "raw/0000/a_0.dng").rename(folder / "raw/0000/foo.dng")
    (folder / "raw/0000/b_0.jpg").rename(folder / "raw/0000/bar.jpg")
    codes = np.full((24, 32, 3), 9, np.uint8)
    (folder / "raw/0000/b_0.jpg").write_bytes(encode_jpeg(codes))
    (folder / "raw/0000/a_0.dng.back").write_bytes(b"mine")
    before = tree(folder / "raw")
    done = repair(folder)
    assert done.unrepaired[0] == (
        "raw/0000/bar.jpg is raw/0000/b_0.jpg: move away what has that name, and rename it back."
    )
    assert (done.dropped, done.added, len(done.renamed)) == ((), (), 1)
    before["0000/a_0.dng"] = before.pop("0000/foo.dng")
    assert tree(folder / "raw") == before


def beside(folder: Path, origin: str, shades: tuple[int, int] = (60, 61)) -> list[Path]:
    """Photographs beside the RAW files of the first two frames, in a session of that origin."""
    index, session = folder / "shots.jsonl", folder / "session.json"
    session.write_text(json.dumps(json.loads(session.read_text()) | {"origin": origin}))
    records = [json.loads(line) for line in index.read_text().splitlines()]
    photos = [folder / f"raw/000{frame}/a_0.jpg" for frame in range(2)]
    for frame, photo in enumerate(photos):
        photo.write_bytes(encode_jpeg(np.full((24, 32, 3), shades[frame], np.uint8)))
        said = {"developed": str(photo.relative_to(folder)), "developed_sha256": store.sha256(photo)}
        next(r for r in records if r["file"] == f"raw/000{frame}/a_0.dng").update(said)
    index.write_text("".join(f"{json.dumps(record)}\n" for record in records))
    return photos


@pytest.mark.parametrize("origin", ["test", "import"])
def test_photographs_beside_raw_files_get_their_names_back_with_them(rig, origin):
    folder = rig.session.folder
    one, two = beside(folder, origin)
    before, index = tree(folder / "raw"), (folder / "shots.jsonl").read_bytes()
    one.rename(folder / "raw/0000/mine.jpg")
    one.with_suffix(".dng").rename(folder / "raw/0000/mine.dng")
    if origin == "import":
        two.rename(folder / "raw/0001/other.jpg")
    else:
        two.rename(one)  # a stranger in its place, which is that of another
    done = repair(folder)
    assert (done.dropped, done.added, done.unrepaired, done.backup) == ((), (), (), None)
    assert len(done.renamed) == 3
    assert (tree(folder / "raw"), (folder / "shots.jsonl").read_bytes()) == (before, index)


@pytest.mark.parametrize("origin", ["test", "import"])
def test_equal_files_all_get_their_names_back(rig, origin):
    folder = rig.session.folder
    photos = beside(folder, origin, (0, 0))
    shots = [folder / f"raw/000{frame}/b_0.jpg" for frame in range(3)]
    records = lines(rig.session)
    for record in records:
        if folder / record["file"] in shots:
            (folder / record["file"]).write_bytes(photos[0].read_bytes())
            record["sha256"] = store.sha256(photos[0])
    write(rig.session, records)
    before, index = tree(folder / "raw"), (folder / "shots.jsonl").read_bytes()
    for path in (*photos, *shots[:2]):
        path.rename(path.with_name(f"mine-{path.name}"))
    done = repair(folder)
    assert (done.dropped, done.added, done.unrepaired, done.backup) == ((), (), (), None)
    assert len(done.renamed) == 4
    assert (tree(folder / "raw"), (folder / "shots.jsonl").read_bytes()) == (before, index)


def test_of_equal_files_the_one_whose_place_is_empty_is_named_first(rig):
    folder = rig.session.folder
    one, two = beside(folder, "test", (0, 0))
    one.write_bytes(encode_jpeg(np.full((24, 32, 3), 9, np.uint8)))
    two.rename(two.with_name("mine.jpg"))
    assert repair(folder).renamed == ("raw/0001/mine.jpg is raw/0001/a_0.jpg, and is called so again",)


def test_files_that_cannot_be_read_stop_nothing(rig, monkeypatch):
    folder = rig.session.folder
    one, _ = beside(folder, "test")
    lost = folder / "raw/0002/a_0.dng"
    lost.rename(lost.with_name("mine.dng"))
    stray, companion = folder / "raw/0002/a.jpg", folder / "raw/0002/a_1.jpg"
    stray.write_bytes(b"stray")
    companion.write_bytes(b"companion")
    sha256 = store.sha256

    def failing(path: Path) -> str:
        if path in (one, stray, companion):
            raise InputError(f"{path} cannot be read.")
        return sha256(path)

    monkeypatch.setattr(store, "sha256", failing)
    done = repair(folder)
    assert (len(done.renamed), done.dropped) == (1, ())
    assert f"{companion} cannot be read." in done.unrepaired
    assert [p.message for p in check(folder).problems if p.kind == "torn"] == [f"{one} cannot be read."]


def test_repair_compares_identities_and_not_records(rig, monkeypatch):
    """Of ten thousand shots, each with each other would be minutes."""
    folder = rig.session.folder
    for frame in range(3):
        (folder / f"raw/000{frame}/a_0.dng").rename(folder / f"raw/000{frame}/mine{frame}.dng")
    compared = []
    same = ShotRecord.__eq__
    monkeypatch.setattr(
        ShotRecord, "__eq__", lambda self, other: compared.append(self) or same(self, other), raising=False
    )
    assert len(repair(folder).renamed) == 3
    assert len(compared) <= 18
