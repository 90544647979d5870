"""The documentation as `make docs` builds it: strictly, once, and as a reader without a network opens it."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

import rig
from rig.cli import COMMANDS
from tests.conftest import MadeOnce

pytest.importorskip("mkdocs", reason="the extra docs is not installed")
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(made_once: MadeOnce) -> Path:
    def build(folder: Path) -> None:
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
        environment = os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=240
        )
        assert done.returncode == 0, done.stderr
        assert "WARNING" not in done.stderr

    return made_once("site", build)


class Fetched(HTMLParser):
    """Files that a browser loads by itself with a page."""

    def __init__(self) -> None:
        super().__init__()
        self.places: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        loads = tag == "link" and attributes.get("rel") in {"stylesheet", "icon", "preload", "preconnect"}
        self.places += [attributes[name] or "" for name in ("src", "data") if attributes.get(name)]
        self.places += [attributes["href"] or ""] if loads else []


def test_pages_load_nothing_from_elsewhere(site: Path) -> None:
    pages = [page for page in site.glob("*.html") if page.name != "404.html"]  # a server shows that one
    assert len(pages) > 15
    for page in pages:
        reader = Fetched()
        reader.feed(page.read_text(encoding="utf-8"))
        assert reader.places
        for place in reader.places:
            assert not re.match(r"(\w+:)?//", place), f"{page.name} loads {place}"
            assert (site / place.partition("?")[0]).is_file(), f"{page.name} lacks {place}"
    for sheet in site.rglob("*.css"):
        outside = re.findall(r"(?:url\(|@import)\s*[\"']?(https?:)?//", sheet.read_text(encoding="utf-8"))
        assert not outside, sheet


@pytest.mark.parametrize("name", ["methods", "methods-calibration"])
def test_every_equation_is_drawn(site: Path, name: str) -> None:
    html = (site / f"{name}.html").read_text(encoding="utf-8")
    source = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    assert (
        html.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">')
        == source.count("$$") / 2
    )
    body = html.partition("<article")[2].partition("</article>")[0]
    visible = re.sub(r"<[^>]+>", "", body)
    assert "\\" not in visible
    assert "$" not in visible


def test_every_command_and_every_public_name_has_its_entry(site: Path) -> None:
    commands = (site / "commands.html").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f'id="rig-{name}"' not in commands] == []
    assert "--luminance READING" in commands
    api = (site / "api.html").read_text(encoding="utf-8")
    assert [name for name in rig.__all__ if f'id="rig.{name}"' not in api] == []
    assert "Open a finished reconstruction" in api
    examples = [path.name for path in (ROOT / "examples").glob("*.py")]
    assert [name for name in examples if f"python examples/{name}" not in api] == []


def test_every_table_is_there(site: Path) -> None:
    tables = (site / "tables.html").read_text(encoding="utf-8")
    names = [path.stem for path in (ROOT / "bench" / "results").glob("*.md")]
    assert names
    assert [name for name in names if f'id="{name}"' not in tables] == []


def test_pictures_are_small() -> None:
    pictures = [path for path in (ROOT / "docs").rglob("*") if path.suffix in (".png", ".jpg")]
    assert len(pictures) > 10
    assert [path.name for path in pictures if path.stat().st_size > 300_000] == []
