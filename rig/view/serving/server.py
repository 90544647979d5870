"""Server of `rig view`: a first picture as soon as possible, then a page for each browser."""

import io
import socket
import threading
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager, redirect_stdout
from types import TracebackType
from typing import Protocol

import viser

from imaging.errors import InputError
from rig.view.pictures.look import Look
from rig.view.serving.access import LOCAL, Access, guarded
from rig.view.serving.first import FirstPicture
from rig.view.serving.frame import Frame
from rig.view.serving.start_view import NARROW, Start, stand
from rig.view.serving.state import State, said_state
from rig.view.serving.window import HERE, Window, css_width, on_hdr_screen

# A browser may leave while its picture is drawn: that picture is not missed.
warnings.filterwarnings("ignore", r"Queued a \w+ on a closed connection", UserWarning)

_ANY = ("0.0.0.0", "::")


class Page(Protocol):
    """Page of one browser, until it is closed."""

    @property
    def look(self) -> Look:
        """Chosen look."""
        ...

    def tell(self, text: str) -> None:
        """Show the state of a training, in Markdown; empty: no training is followed."""
        ...

    def refresh(self) -> None:
        """Draw again: there is something new to see."""
        ...

    def restore(self, state: State) -> None:
        """Show what the address of the browser says; what of it there is not is passed over."""
        ...

    def close(self) -> None:
        """The browser is gone, or another page takes its place."""
        ...

    def clear(self) -> None:
        """Remove all but its picture once closed; that stays until the picture of another page comes."""
        ...


MakePage = Callable[[viser.ClientHandle, Look, Window], Page]
"""Factory of pages: takes a browser, its look, and its window."""


class Viewer:
    """Serves pages until it is closed; use it as a context manager.

    port: where to serve; the next free one if it is taken, and any if it is 0. host: the address to serve at;
    one that other machines reach asks for a token, which `url` has. first: shown until there are pages.
    """

    def __init__(
        self, label: str, port: int = 8080, host: str = LOCAL, first: FirstPicture | None = None
    ) -> None:
        _require_address(host)
        self.host, self.first = host, first
        self.look = Look() if first is None else first.look
        self.access = Access.to(host)
        self.pages: dict[int, Page] = {}
        self._clients: dict[int, viser.ClientHandle] = {}
        self._windows: dict[int, Window] = {}
        self._states: dict[int, State] = {}
        self._make: MakePage | None = None
        self._before = self.look
        self._training_state = ""
        self._changing = threading.Lock()
        self._waiting: dict[int, viser.NotificationHandle] = {}
        with guarded(self.access), _silent():
            self.server = viser.ViserServer(host, port, label=label, verbose=False)
        if first is not None:
            self.begin_at(first.start)
        self.server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self.server.gui.main_panel.dock_right()
        self.server.gui.add_html(f'<span id="{HERE}" hidden></span>')
        self.server.on_client_connect(self._look_at_window)
        self.server.on_client_connect(self._open)
        self.server.on_client_disconnect(self._close)

    @property
    def url(self) -> str:
        """Address of the page, with its token, if it has one."""
        host = socket.gethostname() if self.host in _ANY else self.host
        shown = f"[{host}]" if ":" in host else host
        return f"http://{shown}:{self.server.get_port()}{self.access.query}"

    def begin_at(self, start: Start) -> None:
        """Set the place of cameras in browsers that connect from now on."""
        camera = self.server.initial_camera
        camera.position, camera.look_at, camera.up = start.position, start.look_at, start.up
        camera.fov = start.fov
        self.server.scene.set_up_direction(start.up)

    def show(self, make: MakePage, look: Look, start: Start | None = None) -> None:
        """Give every present and future browser a page, in place of the one it has.

        look: initial look of pages; a browser that chose another keeps it. start: place for their cameras;
        None: they stay.
        """
        with self._changing:
            self._make, self._before, self.look = make, self.look, look
            if start is not None:
                self.begin_at(start)
            for client in self._clients.values():
                self._show(client, start)
            self._before = look

    def tell(self, text: str) -> None:
        """Show the state of a training in every page, in Markdown."""
        with self._changing:
            self._training_state = text
            for page in self.pages.values():
                page.tell(text)

    def refresh(self) -> None:
        """Redraw every page."""
        with self._changing:
            for page in self.pages.values():
                page.refresh()

    @property
    def watched(self) -> bool:
        """True if any browser is connected."""
        return bool(self._clients)

    def close(self) -> None:
        """Close all pages and the server."""
        with self._changing:
            pages, self.pages, self._make = list(self.pages.values()), {}, None
        for page in pages:
            page.close()
        with _silent():
            self.server.stop()

    def __enter__(self) -> "Viewer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _show(self, client: viser.ClientHandle, start: Start | None) -> None:
        """Make a page for a browser that waits for it, or has another one."""
        assert self._make is not None
        state = self._states.pop(client.client_id, None)
        look = self.look if state is None else state.look
        if (waiting := self._waiting.pop(client.client_id, None)) is not None:
            waiting.remove()
        if (before := self.pages.pop(client.client_id, None)) is not None:
            look = self.look if before.look == self._before else before.look
            before.close()
            client.gui.reset()
            before.clear()
        if start is not None:
            stand(client, start)
        page = self._make(client, look, self._windows.get(client.client_id, Window()))
        self.pages[client.client_id] = page
        page.tell(self._training_state)
        if state is not None:
            page.restore(state)

    async def _look_at_window(self, client: viser.ClientHandle) -> None:
        """Remember a window and its address, in the task of its connection."""
        # A camera's image is in pixels of the screen, of which a telephone has several for one of CSS.
        width = css_width.get()
        narrow = (client.camera.image_width if width is None else width) < NARROW
        self._windows[client.client_id] = Window(narrow, on_hdr_screen.get())
        if said_state.get():
            self._states[client.client_id] = State.of(said_state.get(), self.look)

    def _open(self, client: viser.ClientHandle) -> None:
        with self._changing:
            self._clients[client.client_id] = client
            if self._make is not None:
                self._show(client, None)
                return
            if self.first is not None:
                shown = self.look.shown(self.first.light, self.first.exposure)
                frame = Frame(self.first.light, client.camera.aspect)
                client.scene.set_background_image(frame.in_window(shown), format="jpeg", jpeg_quality=90)
            notice = client.add_notification("Opening the scene", "", loading=True, with_close_button=False)
            self._waiting[client.client_id] = notice

    def _close(self, client: viser.ClientHandle) -> None:
        with self._changing:
            self._waiting.pop(client.client_id, None)
            self._clients.pop(client.client_id, None)
            self._windows.pop(client.client_id, None)
            self._states.pop(client.client_id, None)
            page = self.pages.pop(client.client_id, None)
        if page is not None:
            page.close()


def _require_address(host: str) -> None:
    """InputError unless this machine can serve there: viser would try ports for ever."""
    try:
        family, kind, *_, place = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as trial:
            trial.bind(place)
    except (OSError, UnicodeError) as error:  # the latter of names that the DNS cannot have
        raise InputError(
            f"{host} is not an address of this machine: give one that is, or 0.0.0.0 for all of them."
        ) from error


def _silent() -> AbstractContextManager[object]:
    """Silence viser's own output, which is not for users of rig."""
    return redirect_stdout(io.StringIO())
