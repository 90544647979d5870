"""The way from a reconstruction to its session, and what is neither."""

from collections.abc import Callable
from pathlib import Path

import pytest

from imaging.errors import InputError
from imaging.session.paths import find_reconstruction, session_of
from imaging.session.session import Session


@pytest.fixture
def session(tmp_path: Path) -> Path:
    folder = tmp_path / "session"
    folder.mkdir()
    (folder / "session.json").write_text("{}")
    return folder


def test_reconstructions_on_another_disk_are_in_the_session_that_links_to_them(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = tmp_path / "disk" / "scenes"
    (disk / "a").mkdir(parents=True)
    (session / "reconstructions").symlink_to(disk)
    assert session_of(session / "reconstructions" / "a") == session
    monkeypatch.chdir(session / "reconstructions")
    assert session_of(session / "reconstructions" / "." / "a") == session
    assert session_of(disk / "a") is None


def test_a_link_to_a_reconstruction_leads_to_its_session(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = session / "reconstructions" / "a"
    scene.mkdir(parents=True)
    (tmp_path / "best").symlink_to(scene)
    assert session_of(tmp_path / "best") == session
    monkeypatch.chdir(scene)
    assert session_of(Path()) == session


@pytest.mark.parametrize("photo", ["a.JPG", "cam0/a.nef"])
@pytest.mark.parametrize("opened", [Session.open, find_reconstruction])
def test_a_folder_of_photographs_is_to_be_imported_first(
    tmp_path: Path, photo: str, opened: Callable[[Path], object]
) -> None:
    folder = tmp_path / "my photos"
    (folder / photo).parent.mkdir(parents=True)
    (folder / photo).touch()
    with pytest.raises(InputError) as refusal:
        opened(folder)
    assert str(refusal.value) == (
        f"{folder} holds photographs and is no session yet: run `rig import '{folder}' S`, then "
        "`rig calibrate S`."
    )


def test_only_a_session_and_what_is_in_it_are_to_be_reconstructed(session: Path, tmp_path: Path) -> None:
    unfinished = session / "reconstructions" / "a"
    unfinished.mkdir(parents=True)
    for folder in (session, unfinished):
        with pytest.raises(InputError, match="run `rig reconstruct` first"):
            find_reconstruction(folder)
    with pytest.raises(InputError, match=r"has no session\.json: name a session"):
        find_reconstruction(tmp_path)
