"""The page of a scene, served to browsers on this machine alone."""

import functools
import io
import re
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stdout
from pathlib import Path
from types import TracebackType

import viser
import websockets.asyncio.server

from recon.rendering.light_files import stem
from recon.result.scene import Scene
from rig.view.cameras import field_of_view, pose
from rig.view.page import Page

HOST = "127.0.0.1"
_ORIGINS = (re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?"), None)
"""Pages that may connect: a program has none; a page of somebody else's site has its own."""


class Viewer:
    """Serves a scene until it is closed; use it as a context manager.

    port: where to serve; the next free one if it is taken, and any if it is 0.
    """

    def __init__(self, scene: Scene, port: int = 8080) -> None:
        self.scene, self.pages = scene, dict[int, Page]()
        self._drawing = threading.Lock()
        self._references = references(scene)
        with _same_origin(), _silent():
            self.server = viser.ViserServer(HOST, port, label=scene.folder.resolve().name, verbose=False)
        self._arrange()
        self.server.on_client_connect(self._open)
        self.server.on_client_disconnect(self._close)

    @property
    def url(self) -> str:
        """Of the page."""
        return f"http://{HOST}:{self.server.get_port()}"

    def close(self) -> None:
        """Close all pages and the server."""
        for page in list(self.pages.values()):
            page.close()
        self.pages.clear()
        with _silent():
            self.server.stop()

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _arrange(self) -> None:
        """What every browser begins with: the camera of the first view, upright."""
        first = self.scene.views[0]
        camera = self.scene.record.world.camera(first.splat_camera)
        _, position = pose(camera)
        start = self.server.initial_camera
        start.position = tuple(position)
        start.look_at = tuple(position + camera.cam_from_world[2, :3])
        start.up = tuple(self.scene.up)
        start.fov = field_of_view(first)
        self.server.scene.set_up_direction(tuple(self.scene.up))
        self.server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self.server.gui.main_panel.dock_right()

    def _open(self, client: viser.ClientHandle) -> None:
        self.pages[client.client_id] = Page(client, self.scene, self._references, self._drawing)

    def _close(self, client: viser.ClientHandle) -> None:
        page = self.pages.pop(client.client_id, None)
        if page is not None:
            page.close()


def references(scene: Scene) -> dict[str, Path]:
    """The light of views that `rig evaluate` measured the scene by, EXR by name of the view."""
    folder = scene.folder / "references"
    found = {view.name: folder / f"{stem(view)}.exr" for view in scene.views}
    return {name: path for name, path in found.items() if path.is_file()}


@contextmanager
def _same_origin() -> Iterator[None]:
    """Servers that are begun in here refuse pages of other sites, which any browser would let connect.

    viser has no argument for that; `websockets`, with which it serves, has.
    """
    serve = websockets.asyncio.server.serve
    websockets.asyncio.server.serve = functools.partial(serve, origins=_ORIGINS)  # type: ignore
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore


def _silent() -> AbstractContextManager[object]:
    """What viser prints of itself is not for users of rig."""
    return redirect_stdout(io.StringIO())
