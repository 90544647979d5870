"""Files are there whole or not at all, whatever the disk does."""

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging.errors import InputError, StorageError
from imaging.files import store
from tests.trees import tree

Refuse = Callable[..., None]


def names(folder: Path) -> set[str]:
    return {str(f.relative_to(folder)) for f in folder.rglob("*")}


@pytest.fixture
def refuse(monkeypatch: pytest.MonkeyPatch) -> Refuse:
    """Make a call fail with an error number, from its n-th use on."""

    def install(owner: object, name: str, number: int, after: int = 0) -> None:
        plain, calls = getattr(owner, name), [0]

        def call(*arguments: object, **options: object) -> object:
            calls[0] += 1
            if calls[0] > after:
                raise OSError(number, os.strerror(number))
            return plain(*arguments, **options)

        monkeypatch.setattr(owner, name, call)

    return install


def fill(part: Path, text: str) -> None:
    (part / "deep").mkdir(parents=True)
    (part / "a.txt").write_text(text)
    (part / "deep" / "b.txt").write_text(text)


def test_a_file_is_replaced(tmp_path: Path) -> None:
    store.write_bytes(tmp_path / "new" / "folder" / "a.bin", b"one")
    store.write_bytes(tmp_path / "new" / "folder" / "a.bin", b"two")
    assert tree(tmp_path) == {"new/folder/a.bin": b"two"}


def test_a_folder_is_replaced(tmp_path: Path) -> None:
    for text in ("one", "two"):
        with store.replacing(tmp_path / "folder") as part:
            fill(part, text)
    assert tree(tmp_path) == {"folder/a.txt": b"two", "folder/deep/b.txt": b"two"}
    assert names(tmp_path) == {"folder", "folder/a.txt", "folder/deep", "folder/deep/b.txt"}


def test_leftovers_of_a_killed_run_are_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / ".folder.part").mkdir()
    (tmp_path / ".folder.part" / "stale.txt").write_text("stale")
    (tmp_path / ".folder.old.part").mkdir()
    (tmp_path / ".a.bin.part").write_bytes(b"stale")
    with store.replacing(tmp_path / "folder") as part:
        fill(part, "new")
    store.write_bytes(tmp_path / "a.bin", b"new")
    assert tree(tmp_path) == {"folder/a.txt": b"new", "folder/deep/b.txt": b"new", "a.bin": b"new"}


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt, InputError])
@pytest.mark.parametrize("before", [True, False])
def test_a_failing_block_leaves_the_old(tmp_path: Path, failure: type[BaseException], before: bool) -> None:
    if before:
        store.write_bytes(tmp_path / "a.bin", b"old")
        with store.replacing(tmp_path / "folder") as part:
            fill(part, "old")
    contents = tree(tmp_path)

    def write(path: Path) -> None:
        with store.replacing(path) as part:
            if path.suffix:
                part.write_bytes(b"half")
            else:
                fill(part, "half")
            raise failure

    for name in ("a.bin", "folder"):
        with pytest.raises(failure):
            write(tmp_path / name)
    assert tree(tmp_path) == contents
    assert store.leftovers(tmp_path) == []


NO_SPACE, READ_ONLY, DENIED, BROKEN = errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EIO


@pytest.mark.parametrize(
    ("owner", "name", "number", "folder"),
    [
        (store, "sync", NO_SPACE, False),
        (store, "sync", NO_SPACE, True),
        (os, "fsync", NO_SPACE, False),
        (os, "fsync", BROKEN, True),
        (Path, "write_bytes", READ_ONLY, False),
        (Path, "write_text", NO_SPACE, True),
        (Path, "replace", DENIED, False),
        (Path, "rename", DENIED, True),
    ],
)
@pytest.mark.parametrize("before", [True, False])
def test_a_refusing_disk_leaves_the_old(
    tmp_path: Path, refuse: Refuse, owner: object, name: str, number: int, folder: bool, before: bool
) -> None:
    target = tmp_path / "target"

    def write(text: str) -> None:
        if folder:
            with store.replacing(target) as part:
                fill(part, text)
        else:
            store.write_bytes(target, text.encode())

    if before:
        write("old")
    contents = tree(tmp_path)
    refuse(owner, name, number)
    with pytest.raises(StorageError, match=os.strerror(number).lower()) as error:
        write("new")
    assert str(error.value).startswith(str(target))
    assert "\n" not in str(error.value)
    assert tree(tmp_path) == contents
    assert store.leftovers(tmp_path) == []


def test_a_folder_comes_back_when_the_new_one_cannot_be_named(tmp_path: Path, refuse: Refuse) -> None:
    with store.replacing(tmp_path / "folder") as part:
        fill(part, "old")
    contents = tree(tmp_path)
    renames: list[Path] = []
    plain = Path.rename

    def rename(self: Path, target: Path) -> Path:
        renames.append(self)
        if len(renames) == 2:  # the old one has stepped aside
            raise OSError(errno.ENOSPC, "No space left on device")
        return plain(self, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "rename", rename)
        with pytest.raises(StorageError), store.replacing(tmp_path / "folder") as part:
            fill(part, "new")
    assert tree(tmp_path) == contents
    assert store.leftovers(tmp_path) == []


def test_a_disk_that_refuses_everything_still_says_so(tmp_path: Path, refuse: Refuse) -> None:
    refuse(store, "sync", errno.EROFS)
    refuse(Path, "unlink", errno.EROFS, after=1)
    with pytest.raises(StorageError, match="read-only"):
        store.write_bytes(tmp_path / "a.bin", b"data")


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StorageError, match="file"):
        store.make_folder(tmp_path / "file" / "folder")
    with pytest.raises(StorageError, match="file"):
        store.write_bytes(tmp_path / "file" / "a.bin", b"")


def test_only_numbers_are_written_as_json(tmp_path: Path) -> None:
    for value in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match="JSON"):
            store.write_json(tmp_path / "a.json", {"x": value})
        with pytest.raises(ValueError, match="JSON"):
            store.append_line(tmp_path / "a.jsonl", {"x": value})
    assert names(tmp_path) == set()
    store.write_json(tmp_path / "a.json", {"x": [1, 2.5, None, "ü"]})
    assert store.read_json(tmp_path / "a.json") == {"x": [1, 2.5, None, "ü"]}


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe\xfd", b"[" * 100_000, b"\0" * 40])
def test_damaged_json_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.json cannot be read as JSON"):
        store.read_json(tmp_path / "a.json")
    (tmp_path / "a.jsonl").write_bytes(b'{"ok": 1}\n' + content + b"\n")
    with pytest.raises(InputError, match=r"a\.jsonl, line 2 is not JSON"):
        store.read_lines(tmp_path / "a.jsonl")


def test_what_is_missing_or_a_folder(tmp_path: Path) -> None:
    assert store.read_lines(tmp_path / "none.jsonl") == []
    with pytest.raises(InputError, match="is missing"):
        store.read_json(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be read"):
        store.sha256(tmp_path / "none")
    for read in (store.read_json, store.read_lines, store.sha256):
        with pytest.raises(InputError, match="cannot be read"):
            read(tmp_path)


LINES = [{"i": i, "text": "é\n" * i} for i in range(6)]


@settings(max_examples=80)
@given(st.data())
def test_a_torn_line_is_dropped_and_then_cut_off(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("lines") / "a.jsonl"
    whole = "".join(json.dumps(line) + "\n" for line in LINES).encode()
    cut = data.draw(st.integers(0, len(whole)))
    garbage = data.draw(st.sampled_from([b"", b"\0\0\0\0", b"{"]))
    path.write_bytes(whole[:cut] + garbage)
    whole_lines = whole[:cut].count(b"\n")
    assert store.read_lines(path) == LINES[:whole_lines]
    store.append_line(path, {"new": True})
    assert store.read_lines(path) == [*LINES[:whole_lines], {"new": True}]


def test_a_line_that_the_disk_refuses(tmp_path: Path, refuse: Refuse) -> None:
    store.append_line(tmp_path / "a.jsonl", {"i": 1})
    refuse(os, "fsync", errno.ENOSPC)
    with pytest.raises(StorageError, match="no space left"):
        store.append_line(tmp_path / "a.jsonl", {"i": 2})
    # whether it is on the disk is not known; what was before, is
    assert store.read_lines(tmp_path / "a.jsonl")[0] == {"i": 1}


def test_digest(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert store.sha256(tmp_path / "a").startswith("ba7816bf8f01cfea")


@pytest.mark.parametrize(
    "relative", ["../x", "a/../../x", "/etc/passwd", "..", "a/..", "link/x", "loop", "a\0b", "x" * 300]
)
def test_paths_that_lead_out_are_refused(tmp_path: Path, relative: str) -> None:
    session = tmp_path / "session"
    session.mkdir()
    (session / "link").symlink_to(tmp_path)
    (session / "loop").symlink_to(session / "loop")
    with pytest.raises(InputError, match="leads out of"):
        store.inside(session, relative)


def test_paths_inside_are_allowed_through_links_too(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "session").symlink_to(tmp_path / "real")
    (tmp_path / "real" / "a.dng").write_bytes(b"")
    (tmp_path / "real" / "same").symlink_to(tmp_path / "real" / "a.dng")
    for name in ("a.dng", "same", "raw/0001/not_yet.dng", "raw/./a..b.dng"):
        assert store.inside(tmp_path / "session", name) == tmp_path / "session" / name


def _killed_between_two_renames(folder: Path) -> Path:
    """The old `colmap` has stepped aside, the new one has not come."""
    old = folder / ".colmap.old.part"
    old.mkdir()
    (old / "kept").write_text("x")
    (folder / ".colmap.part").mkdir()
    return folder / "colmap"


def test_a_folder_that_stepped_aside_is_no_leftover(tmp_path: Path) -> None:
    colmap = _killed_between_two_renames(tmp_path)
    assert [path.name for path in store.leftovers(tmp_path)] == [".colmap.part"]
    assert (colmap / "kept").read_text() == "x"


def test_a_folder_that_stepped_aside_outlives_a_second_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    colmap, rename = _killed_between_two_renames(tmp_path), Path.rename

    def refuse_the_new(path: Path, target: Path) -> Path:
        if path.name == ".colmap.part":
            raise OSError(5, "Input/output error")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", refuse_the_new)
    with pytest.raises(StorageError), store.replacing(colmap) as part:
        part.mkdir()
    assert (colmap / "kept").read_text() == "x"


def test_leftovers_are_found_and_discarded(tmp_path: Path, refuse: Refuse) -> None:
    (tmp_path / ".a.part").write_bytes(b"")
    (tmp_path / ".b.part").mkdir()
    (tmp_path / "c.part").write_bytes(b"")
    assert [path.name for path in store.leftovers(tmp_path)] == [".a.part", ".b.part"]
    for path in store.leftovers(tmp_path):
        store.discard(path)
    assert names(tmp_path) == {"c.part"}
    refuse(Path, "unlink", errno.EROFS)
    with pytest.raises(StorageError, match="read-only"):
        store.discard(tmp_path / "c.part")


def test_json_is_readable_text(tmp_path: Path) -> None:
    store.write_json(tmp_path / "a.json", {"a": 1})
    text = (tmp_path / "a.json").read_text()
    assert text.endswith("}\n")
    assert json.loads(text) == {"a": 1}
