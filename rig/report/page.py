"""A page: its parts, and how it becomes one HTML file."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined

from imaging import store
from rig.report.calibrated import Calibrated
from rig.report.captured import Captured
from rig.report.provenance import Provenance

if TYPE_CHECKING:
    # These bring torch with them, which a calibration does not need.
    from rig.report.comparisons import Pictures
    from rig.report.quality import Quality
    from rig.report.trade_page import TradeOff

SECTIONS = {
    "trade": "Trade-offs",
    "pictures": "Pictures",
    "quality": "Quality",
    "captured": "Capture",
    "calibrated": "Calibration",
    "provenance": "Provenance",
}


@dataclass(frozen=True)
class Tile:
    """A headline number."""

    value: str
    unit: str
    label: str


@dataclass(frozen=True)
class Page:
    """What a page shows; a section that is None is left out."""

    kind: str
    title: str
    lead: str
    version: str
    made: str
    tiles: tuple[Tile, ...] = ()
    trade: "TradeOff | None" = None
    pictures: "Pictures | None" = None
    quality: "Quality | None" = None
    captured: Captured | None = None
    calibrated: Calibrated | None = None
    provenance: Provenance | None = None

    @property
    def contents(self) -> list[tuple[str, str]]:
        """Anchor and name of every section that is there."""
        return [(name, title) for name, title in SECTIONS.items() if getattr(self, name) is not None]


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
