"""A training in another process, and the page that follows it."""

import itertools
import multiprocessing
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from imaging.files.store import replace_folder
from imaging.session.lock import held
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.result.live_scene import SNAPSHOT, WANTED, read_snapshot
from recon.result.scene import Scene, open_scene
from rig.commands.view import _followed, view
from rig.view.pages import follow, session_page
from rig.view.pages.follow import Follower, training_in
from rig.view.pages.page import ScenePage
from rig.view.pages.session_page import SessionPage, show_session
from rig.view.pictures.look import Look
from rig.view.serving import server
from rig.view.serving.server import Viewer
from tests.rig.view.conftest import Window

ITERATIONS = 120


def train(pipe: Connection, session: Path, name: str) -> None:
    """A process that trains and, at each line of its log, waits until it may go on."""
    from recon.reconstruct import reconstruct

    def log(line: dict) -> None:
        pipe.send(line["iteration"])
        pipe.recv()

    ticks = itertools.count(0.0, 2.0)  # a snapshot is due whenever one is asked for
    options = Overrides(iterations=ITERATIONS, gaussians=400, refine="none", degree=0, environment=False)
    reconstruct(
        session,
        TrainingRequest(quality="draft", name=name, overrides=options),
        on_log=log,
        clock=lambda: next(ticks),
    )


class Training:
    """The process, from here."""

    def __init__(self, session: Path, name: str) -> None:
        forking = multiprocessing.get_context("forkserver")
        forking.set_forkserver_preload([__name__, "recon.reconstruct"])  # imported once for all trainings
        self.pipe, other = forking.Pipe()
        self.process = forking.Process(target=train, args=(other, session, name))
        self.process.start()
        other.close()

    def next(self) -> int:
        """The iteration that it waits at next."""
        assert self.pipe.poll(60)
        return int(self.pipe.recv())

    def go_on(self) -> None:
        self.pipe.send(None)

    def finish(self) -> None:
        """Let it come to its end."""
        self.go_on()
        while self.process.is_alive():
            try:
                if self.pipe.poll(60):
                    self.pipe.recv()
                    self.go_on()
            except (EOFError, BrokenPipeError):
                break
        self.process.join(60)


@contextmanager
def training(session: Path, name: str) -> Iterator[Training]:
    begun = Training(session, name)
    try:
        yield begun
    finally:
        begun.process.kill()
        begun.process.join()


@pytest.fixture
def session(toy_template: Path, tmp_path: Path) -> Path:
    """Calibrated, without a scene."""
    folder = tmp_path / "toy"
    shutil.copytree(toy_template, folder, ignore=shutil.ignore_patterns("reconstructions"))
    return folder


def note(viewer: Viewer) -> str:
    (page,) = viewer.pages.values()
    assert isinstance(page, SessionPage | ScenePage)
    note = page.controls.note if isinstance(page, ScenePage) else page._note
    return note.words.content


def shown(window: Window, viewer: Viewer) -> ScenePage:
    """The page of the scene, once it has a picture of it."""
    (page,) = viewer.pages.values()
    assert isinstance(page, ScenePage)
    window.page = page
    window.until(lambda: page.frame is not None and page.frame.light.shape[1] == window.width)
    return page


def drawn(scene: Scene, page: ScenePage) -> np.ndarray:
    """The scene from where the browser stands now: it may report its camera after its first picture."""
    return scene.render(scene.record.world.camera_in_world(page._wanted(coarse=False).camera))


def test_a_training_is_shown_as_it_goes_and_the_scene_in_the_end(session: Path, open_window) -> None:
    scene = session / "reconstructions" / "live"
    with Viewer("toy", 0) as viewer:
        show_session(viewer, session)
        follower = Follower(viewer, session)
        window = open_window(viewer)
        assert "None is under way" in note(viewer)
        with training(session, "live") as process:
            first = process.next()
            assert _followed(session) == _followed(scene) == session
            follower.look()
            assert "waiting for its first picture" in note(viewer)
            assert (scene / WANTED).exists()
            process.go_on()
            assert process.next() > first
            follower.look()
            snapshot = read_snapshot(scene).scene
            assert f"iteration **{first}** of {ITERATIONS}" in note(viewer)
            page = shown(window, viewer)
            window.until(
                lambda: window.shows(
                    lambda: Look(tones="AgX").shown(drawn(snapshot, page), snapshot.exposure)
                )
            )
            follower.look()
            assert (scene / WANTED).exists()  # the next is asked for
            process.finish()
        follower.look()
        assert f"Finished after {ITERATIONS} iterations, held-out views **" in note(viewer)
        assert not (scene / SNAPSHOT).exists()
        page = shown(window, viewer)
        finished = open_scene(scene)

        def is_drawn() -> bool:
            truth = drawn(finished, page)
            return page.frame.light.shape == truth.shape and np.allclose(page.frame.light, truth, rtol=1e-4)

        window.until(is_drawn)
        assert _followed(session) is None


def test_a_training_that_is_killed_is_told_of(session: Path, open_window) -> None:
    with Viewer("toy", 0) as viewer:
        show_session(viewer, session)
        follower = Follower(viewer, session)
        open_window(viewer)
        with training(session, "live") as process:
            process.next()
            follower.look()
            process.go_on()
            process.next()
            follower.look()
            assert "iteration **" in note(viewer)
        follower.look()
        assert "**live** failed or was killed" in note(viewer)
        Follower(viewer, session)
        assert "**live** was stopped" in note(viewer)


def test_a_scene_that_replaces_another_is_shown_in_its_place(scene: Path, open_window) -> None:
    """And a training that does not answer is told of."""
    now, (finished,) = [0.0], (scene / "reconstructions").iterdir()
    new = finished.with_name(f".{finished.name}.new")
    shutil.copytree(finished, new)
    with Viewer("toy", 0) as viewer:
        show_session(viewer, scene)
        follower = Follower(viewer, scene, clock=lambda: now[0])
        open_window(viewer)
        assert _followed(scene) is None
        with held(new):
            assert _followed(scene) == scene
            follower.look()
            assert f"**{finished.name}** is being trained" in note(viewer)
            now[0] = 40.0
            follower.look()
            assert "No news for 30 s" in note(viewer)
        follower.look()
        assert "Finished after" in note(viewer)
        replace_folder(new, finished)
        follower.look()
        assert follower._painter.scene.folder == finished


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """A session with the folders of two trainings, of which B is the newer; A replaces another scene."""
    (tmp_path / "session.json").write_text("{}")
    for age, name in enumerate(("B", ".A.new")):
        folder = tmp_path / "reconstructions" / name
        folder.mkdir(parents=True)
        os.utime(folder, (1000 - age, 1000 - age))
    return tmp_path


def test_the_training_that_is_named_is_followed(two: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    new, newer = (two / "reconstructions" / name for name in (".A.new", "B"))
    with held(new), held(newer):
        assert training_in(two) == training_in(two, "B") == newer
        assert training_in(two, "A") == new
        names = []
        monkeypatch.setattr(server, "Viewer", lambda *_: nullcontext(SimpleNamespace(url="")))
        monkeypatch.setattr(session_page, "show_session", lambda *_: None)
        monkeypatch.setattr(
            follow, "Follower", lambda *its: names.append(its[2]) or SimpleNamespace(run=lambda: None)
        )
        for path in (new, newer, two):
            view([path])
    assert names == ["A", "B", None]


def test_a_training_that_gets_its_final_name_meanwhile_is_found_next_time(
    two: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new = two / "reconstructions" / ".A.new"
    final = new.with_name("A")

    def renamed(folder: Path) -> bool:
        if folder == new:
            new.rename(final)
        return folder.name != "B"

    monkeypatch.setattr(follow, "is_held", renamed)
    assert training_in(two) is None
    assert training_in(two) == final
