"""State of a page, as text behind the # of its address: a link leads to the same spot, a reload back to
it.

The page's script (`window`) keeps the address and a cookie, by which the server learns of it when a browser
connects.
"""

import html
import math
from contextvars import ContextVar
from dataclasses import dataclass, field
from urllib.parse import parse_qsl, urlencode

from recon.result.first_look import MOST_STOPS
from rig.view.pictures.look import TONE_MAPS, Look
from rig.view.serving.start_view import Start

ELEMENT = "rig-state"
"""Element of the page whose title is the state."""
_FAR = 1e6

said_state: ContextVar[str] = ContextVar("said_state", default="")
"""Text behind the # of the address of the present connection."""


@dataclass(frozen=True)
class State:
    """State of a page. look: exposure and tones. view, show: as the choices of the page name them, "" for
    none. start: place of the camera; None: that of the page. centre: of a view that is shown pixel for pixel.
    """

    look: Look = field(default_factory=Look)
    view: str = ""
    show: str = ""
    start: Start | None = None
    centre: tuple[float, float] | None = None

    @property
    def text(self) -> str:
        """Format for an address."""
        parts = {"stops": f"{self.look.exposure:g}", "tones": str(self.look.tones)}
        parts |= {"view": self.view, "show": self.show}
        if self.centre is not None:
            parts["centre"] = " ".join(f"{value:.5g}" for value in self.centre)
        if self.start is not None:
            for name in ("position", "look_at", "up"):
                parts[name] = " ".join(f"{value:.5g}" for value in getattr(self.start, name))
            parts["fov"] = f"{self.start.fov:.5g}"
        return urlencode({name: value for name, value in parts.items() if value})

    @property
    def element(self) -> str:
        """HTML that shows nothing, and that the page's script reads."""
        return f'<span id="{ELEMENT}" title="{html.escape(self.text)}" hidden></span>'

    @classmethod
    def of(cls, text: str, usual: Look) -> "State":
        """Parse the text in an address, which may be arbitrary: invalid parts are left out.

        usual: exposure and tones where the text names none.
        """
        parts = dict(parse_qsl(text))
        stops = _numbers(parts.get("stops", ""), 1, MOST_STOPS)
        tones = next((tones for tones in TONE_MAPS if tones == parts.get("tones")), usual.tones)
        points = [_numbers(parts.get(name, ""), 3, _FAR) for name in ("position", "look_at", "up")]
        fov = _numbers(parts.get("fov", ""), 1, math.pi)
        start = None
        if all(points) and fov and fov[0] > 0 and points[0] != points[1] and any(points[2]):
            position, look_at, up = ((x, y, z) for x, y, z in points)
            start = Start(position, look_at, up, fov[0])
        across, down = _numbers(parts.get("centre", ""), 2, 1.0) or (-1.0, -1.0)
        centre = (across, down) if min(across, down) >= 0 else None
        look = Look(stops[0] if stops else usual.exposure, tones)
        return cls(look, parts.get("view", ""), parts.get("show", ""), start, centre)


def _numbers(text: str, count: int, most: float) -> list[float]:
    """Parse that many numbers; empty if one is missing or too large."""
    try:
        numbers = [float(part) for part in text.split()]
    except ValueError:
        return []
    return numbers if len(numbers) == count and all(abs(value) <= most for value in numbers) else []
