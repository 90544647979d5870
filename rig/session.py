"""A session in Python: the one on the disk, with what a notebook shows of it."""

import time

from imaging.errors import RigError
from imaging.notebook import gallery
from imaging.session import session
from imaging.session.session import brackets

SHEET_MOST = 12
"""Pictures on the contact sheet of a notebook, evenly chosen."""
SHEET_SECONDS = 4.0
"""RAW files of many megapixels take a second each; the sheet ends with the first beyond this."""


class Session(session.Session):
    """A session on disk: `Session.open("S")`. It can be given where a path to its folder can.

    It holds no state but its identity: every read sees what is there now.
    """

    def _repr_html_(self) -> str:
        """Return what a notebook shows: what the session holds, and a shot of some of its views."""
        from capture.pictures.read import examine

        views = list(brackets(self.shots("scene")).items())
        chosen = views[:: -(-len(views) // SHEET_MOST) or 1]
        pictures, began = [], time.monotonic()
        for view, shots in chosen:
            shot = shots[len(shots) // 2]
            try:
                thumbnail = examine(self.file(shot)).thumbnail
            except (RigError, OSError):
                continue  # `rig check` names what cannot be read
            exposure = shot.reported or shot.requested
            pictures.append((f"{view}, {exposure}" if exposure else str(view), thumbnail))
            if time.monotonic() - began > SHEET_SECONDS:
                break
        return gallery(self.summary(), pictures)
