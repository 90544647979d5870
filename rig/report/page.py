"""A page: its parts, and how it becomes one HTML file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from imaging.files import store
from rig.report.charts.topic import Tile

SECTIONS = {
    "batch": "Scenes",
    "trade": "Trade-offs",
    "pictures": "Pictures",
    "quality": "Quality",
    "captured": "Capture",
    "calibrated": "Calibration",
    "provenance": "Provenance",
}


@dataclass(frozen=True)
class Page:
    """Contents of a page. sections: by name, each drawn by the template of that name."""

    kind: str
    title: str
    lead: str
    version: str
    made: str
    tiles: tuple[Tile, ...] = ()
    sections: Mapping[str, object] = field(default_factory=dict)

    @property
    def contents(self) -> list[tuple[str, str]]:
        """Anchor and title of every section, in the order of the page."""
        return [(name, title) for name, title in SECTIONS.items() if name in self.sections]


def environment() -> Environment:
    """Jinja2 with everything escaped that is not made by us, and a missing value an error."""
    return Environment(
        loader=PackageLoader("rig.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )


def write_page(path: Path, page: Page) -> None:
    """Write the page whole, or nothing."""
    values: Mapping[str, object] = {"page": page}
    html = environment().get_template("page.html").render(values)
    # A file name may hold halves of characters that UTF-8 cannot carry.
    store.write_bytes(path, html.encode("utf-8", "replace"))


def now() -> str:
    """The time of making, as people write it."""
    return datetime.now().astimezone().strftime("%d %B %Y, %H:%M")
