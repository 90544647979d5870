"""A training that goes on in another process, shown as it goes; and the session or the scene around it.

Both meet in the scene's folder (`recon.result.live_scene`): the page asks for a snapshot, shows it when it is
there, and asks again. Once the training is over the finished scene takes its place.
"""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from imaging.errors import RigError
from imaging.session.lock import is_held
from recon.result.live_scene import SNAPSHOT, Snapshot, ask, read_snapshot
from recon.result.model import CHECKPOINT, LOG, MODEL, ModelRecord
from recon.result.scene import Scene, open_scene
from rig.terminal.text import number
from rig.view.pages.opening import painter_of, show_painter
from rig.view.pictures.painter import Painter
from rig.view.serving.server import Viewer

PERIOD = 0.4
"""Seconds between two looks at the disk."""
LONG = 30.0
"""Seconds after which a training that does not respond is reported."""
NONE = "None is under way: what `rig reconstruct` trains is shown here as it goes."


def training_in(session: Path, name: str | None = None) -> Path | None:
    """Folder in which a process trains a scene of a name, or any: the newest of several, or None."""
    running = []
    for folder in session.glob("reconstructions/*/"):
        if name in (None, name_of(folder)) and is_held(folder):
            with suppress(FileNotFoundError):  # it has just got its final name: found by that next time
                running.append((folder.stat().st_mtime_ns, folder))
    return max(running)[1] if running else None


class Follower:
    """Follower of a session, or of its one scene of a name, which keeps a viewer up to date."""

    def __init__(
        self,
        viewer: Viewer,
        session: Path,
        name: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.viewer, self.session, self.name, self.clock = viewer, session, name, clock
        self._training: Path | None = None
        self._finished_before: object = None
        self._shown_stamp: object = None
        self._shown_at = 0.0
        self._opened: Path | None = None
        self._painter: Painter | None = None
        self._last: Snapshot | None = None
        self._say(_unfinished(session))

    def run(self) -> None:
        """Follow until Ctrl-C."""
        pause = threading.Event()
        while True:
            self.look()
            pause.wait(PERIOD)

    def look(self) -> None:
        """Update once; failures are shown in the page, and retried at the next update."""
        try:
            training = training_in(self.session, self.name)
            if training is not None and training != self._training:
                self._begin(training)
            if self._training is None:
                return
            if training is None:
                self._end(self._training)
            elif self.viewer.watched:
                self._follow(training)
        except RigError as error:
            self._say(str(error))

    def _begin(self, training: Path) -> None:
        self._training, self._opened, self._shown_stamp, self._last = training, None, None, None
        self._finished_before = _stamp(_final(training) / MODEL) if training != _final(training) else None
        self._shown_at = self.clock()
        self._say(f"**{name_of(training)}** is being trained: waiting for its first picture.")

    def _follow(self, training: Path) -> None:
        """Show a new snapshot, if there is one, and ask for the next."""
        stamp = _stamp(training / SNAPSHOT)
        if stamp is not None and stamp != self._shown_stamp:
            self._last = read_snapshot(training)
            self._shown_stamp, self._shown_at = stamp, self.clock()
            self._show(self._last.scene)
            self._say(_progress(training, self._last))
        elif self.clock() - self._shown_at > LONG:
            said = "" if self._last is None else _progress(training, self._last) + "\n\n"
            self._say(said + f"No news for {LONG:.0f} s: the training is busy, or paused.")
        ask(training)

    def _end(self, training: Path) -> None:
        """Show what a training that is over left behind."""
        final = _final(training)
        stamp = _stamp(final / MODEL)
        if stamp is not None and stamp != self._finished_before:
            self._open(final)
        elif (training / MODEL).is_file():
            self._open(training)  # until it is where it belongs
            return
        else:
            self._say(
                f"The training of **{name_of(training)}** failed or was killed, so there is no finished "
                "scene: its terminal says why; the same `rig reconstruct` goes on from its last checkpoint."
            )
        self._training = None

    def _open(self, folder: Path) -> None:
        if folder != self._opened:
            scene = open_scene(folder)
            self._show(scene)
            self._say(_outcome(scene.record))
            self._opened = folder

    def _show(self, scene: Scene) -> None:
        painter = self._painter
        if painter is not None and _alike(painter.scene, scene):
            painter.turn_to(scene)
            self.viewer.refresh()
            return
        stay = painter is not None and painter.scene.record.world == scene.record.world
        self._painter = painter_of(scene)
        show_painter(self.viewer, self._painter, None, stay=stay)

    def _say(self, text: str) -> None:
        self.viewer.tell(text)


def _alike(one: Scene, other: Scene) -> bool:
    """Return whether a page of one scene is a page of the other."""
    names = ([view.name for view in scene.views] for scene in (one, other))
    first, second = names
    far = (one.renderer.environment is None) == (other.renderer.environment is None)
    same_world = one.record.world == other.record.world
    return first == second and far and same_world and one.record.degree == other.record.degree


def _final(training: Path) -> Path:
    """Return where the scene of a training is in the end (`recon.result.training_folder`)."""
    return training.with_name(name_of(training))


def name_of(training: Path) -> str:
    """Return the name that the scene of a training has in the end."""
    name = training.name
    return name[1:].removesuffix(".new") if name.startswith(".") else name


def _stamp(path: Path) -> object:
    """Stamp that changes with the file; None without a file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size


def _unfinished(session: Path) -> str:
    """Return the state of a session without a running training."""
    for folder in sorted(session.glob("reconstructions/*/")):
        begun = (folder / CHECKPOINT).is_file() or (folder / LOG).is_file()
        if begun and not (folder / MODEL).is_file():
            return f"**{name_of(folder)}** was stopped: `rig reconstruct` goes on with it, and is shown here."
    return NONE


def _progress(training: Path, snapshot: Snapshot) -> str:
    record = snapshot.scene.record
    share = 100 * record.iterations / max(snapshot.total, 1)
    done = f"iteration **{record.iterations:,}** of {snapshot.total:,}, {share:.0f} %"
    lines = [f"**{name_of(training)}**: {done}"]
    if snapshot.moment is not None:
        iteration, db = snapshot.moment
        lines.append(f"held-out views **{db:.1f} dB** at {record.width} px, iteration {iteration:,}")
    lines.append(f"{record.gaussians:,} Gaussians, {record.train_seconds:.0f} s")
    if record.loss is not None:
        lines.append(f"loss {number(record.loss)}")
    return "  \n".join(lines)


def _outcome(record: ModelRecord) -> str:
    quality = (
        ""
        if record.held_out_db is None
        else f", held-out views **{record.held_out_db:.1f} dB** at {record.width} px"
    )
    after = f"after {record.iterations:,} iterations{quality}"
    if record.ending == "interrupted":
        return f"Stopped {after}: the same `rig reconstruct` goes on."
    return f"Finished {after}."
