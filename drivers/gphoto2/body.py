"""An opened camera of libgphoto2: its settings, a shot, and the files of it."""

import math
from contextlib import suppress
from time import monotonic
from typing import Any

from drivers.gphoto2 import formats
from drivers.gphoto2.library import errors_translated, library
from imaging.errors import CameraError

Place = tuple[str, str]
"""Folder and name of a file in the camera."""
_SECOND_FILE = 2.0
"""Seconds of silence after which a body that is set to RAW and JPEG has no other file."""
_LONGEST_WAIT = 10.0
"""Seconds for the other file of a body that keeps telling other things."""
_MEMORY = "/"
"""The folder of what a body hands over from its memory: libgphoto2 keeps it until it is deleted."""


class Body:
    """A camera from open to close; every call is answered by libgphoto2, and errors are CameraErrors."""

    def __init__(self, model: str, port: str, where: str) -> None:
        """model: as libgphoto2 calls it, such as `PTP/IP Camera`; where: names it in messages."""
        gp = library()
        self._gp, self._where, self._camera = gp, where, gp.Camera()
        self._format, self._both = "", False
        with errors_translated(where):
            models, ports = gp.CameraAbilitiesList(), gp.PortInfoList()
            models.load()
            self._camera.set_abilities(models[models.lookup_model(model)])
            ports.load()
            self._camera.set_port_info(ports[ports.lookup_path(port)])
            self._camera.init()
        try:
            with errors_translated(where):
                self._names = frozenset(_names(gp, self._camera.get_config()))
                operations = self._camera.get_abilities().operations
                self._shoots = bool(operations & gp.GP_OPERATION_CAPTURE_IMAGE)
            self._prepare()
        except CameraError:
            self.close()
            raise

    def can_shoot(self) -> bool:
        """Return whether libgphoto2 can trigger it."""
        return self._shoots

    def text(self, name: str, otherwise: str = "") -> str:
        """Return the value of a setting, or `otherwise` if there is no setting of that name."""
        if name not in self._names:
            return otherwise
        with errors_translated(self._where):
            return str(self._camera.get_single_config(name).get_value())

    def choices(self, name: str) -> list[str]:
        """The choices of a setting, none where there is no such setting or it cannot be set."""
        if name not in self._names:
            return []
        with errors_translated(self._where):
            widget = self._camera.get_single_config(name)
            return [] if widget.get_readonly() else self._listed(widget)

    def set(self, name: str, choice: str) -> str:
        """Set one of the choices, unless it is there already, and read back what the camera then has."""
        with errors_translated(self._where):
            widget = self._camera.get_single_config(name)
            if str(widget.get_value()) != choice:
                widget.set_value(choice)
                self._camera.set_single_config(name, widget)
        return self.text(name)

    def delivers_raw(self) -> bool:
        """Return whether its pictures are RAW files: by its format, or else by what it says it captures."""
        format_text = self.text(self._format)
        if format_text and "unknown" not in format_text.lower():
            return formats.says_raw(format_text)
        with errors_translated(self._where):
            summary = str(self._camera.get_summary())
        lines = [line for line in summary.splitlines() if line.startswith("Capture Formats:")]
        return any(formats.says_raw(line) for line in lines)

    def shoot(self) -> Place:
        """Expose, wait until the picture is stored, and return its place."""
        with errors_translated(self._where):
            path = self._camera.capture(self._gp.GP_CAPTURE_IMAGE)
        return str(path.folder), str(path.name)

    def beside(self, first: Place) -> Place | None:
        """The other file of a shot by a body that is set to RAW and JPEG; None if none comes."""
        if not self._both:
            return None
        deadline = monotonic() + _LONGEST_WAIT
        with errors_translated(self._where):
            while (remaining := deadline - monotonic()) > 0:
                milliseconds = math.ceil(1000 * min(_SECOND_FILE, remaining))
                kind, stored = self._camera.wait_for_event(milliseconds)
                if kind == self._gp.GP_EVENT_FILE_ADDED and (stored.folder, stored.name) != first:
                    return str(stored.folder), str(stored.name)
                if kind == self._gp.GP_EVENT_TIMEOUT:
                    break
        self._both = False  # it says so, and does not: later shots do not wait for it
        return None

    def fetch(self, place: Place) -> bytes:
        """All bytes of a file."""
        with errors_translated(self._where):
            file = self._camera.file_get(*place, self._gp.GP_FILE_TYPE_NORMAL)
            return bytes(file.get_data_and_size())

    def forget(self, place: Place) -> None:
        """Drop a file that was in memory; on a card it stays."""
        if place[0] == _MEMORY:
            with suppress(CameraError), errors_translated(self._where):
                self._camera.file_delete(*place)

    def close(self) -> None:
        """Let go of it."""
        with suppress(CameraError), errors_translated(self._where):
            self._camera.exit()

    def _prepare(self) -> None:
        """RAW where there is a choice, and no focusing before each shot."""
        self._format = next((name for name in formats.FORMATS if name in self._names), "")
        if "autofocus" in self._names:
            with suppress(CameraError):  # it focuses then: the shot is the same
                self.set("autofocus", "Off")
        format_text = self.text(self._format)
        if self._format and not formats.says_raw(format_text):
            wanted = formats.plain_raw(self.choices(self._format))
            if wanted is not None:
                format_text = self.set(self._format, wanted)
        self._both = formats.says_both(format_text)

    def _listed(self, widget: Any) -> list[str]:
        kinds = (self._gp.GP_WIDGET_RADIO, self._gp.GP_WIDGET_MENU)
        if widget.get_type() not in kinds:
            return []
        return [str(widget.get_choice(at)) for at in range(widget.count_choices())]


def _names(gp: Any, widget: Any) -> list[str]:
    """The names of all settings below this one."""
    if widget.get_type() not in (gp.GP_WIDGET_WINDOW, gp.GP_WIDGET_SECTION):
        return [str(widget.get_name())]
    below = [widget.get_child(at) for at in range(widget.count_children())]
    return [name for child in below for name in _names(gp, child)]
