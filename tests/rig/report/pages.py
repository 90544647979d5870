"""Reads a report page as strictly as HTML allows: balance, ids, links, pictures, scripts."""

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "img", "br", "hr", "link", "input", "col"}
"""Elements of HTML without an end tag."""


@dataclass
class Page(HTMLParser):
    """Everything that the tests ask of a page. Raises AssertionError where tags do not balance."""

    html: str
    text: str = ""
    tags: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    stack: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.feed(self.html)
        self.close()
        assert not self.stack, f"not closed: {self.stack}"

    @classmethod
    def read(cls, path: Path) -> "Page":
        return cls(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.stack.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.stack, f"</{tag}> closes nothing"
        assert self.stack[-1] == tag, f"</{tag}> closes <{self.stack[-1]}>"
        self.stack.pop()

    def handle_data(self, data: str) -> None:
        if "style" not in self.stack:
            self.text += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def assert_self_contained(page: Page) -> None:
    """Nothing is loaded, nothing runs, every picture is inside and has words, every anchor a target."""
    names = {tag for tag, _ in page.tags}
    assert not names & {"script", "iframe", "object", "embed", "link", "base", "form", "audio", "video"}
    ids = [attributes["id"] for _, attributes in page.tags if attributes.get("id")]
    assert len(ids) == len(set(ids))
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), (tag, attributes)
        for name in ("src", "href", "xlink:href", "action", "poster", "srcset", "data"):
            value = attributes.get(name)
            if tag == "a" and value is not None and re.fullmatch(r"[\w.%-]+", value):
                continue  # a file beside the page, which is opened only when somebody asks for it
            if value is not None:
                assert value.startswith("data:image/") or value[0] == "#", (tag, name, value[:80])
                assert value[0] != "#" or value[1:] in ids
        assert "http" not in (attributes.get("style") or "")
    assert "@import" not in page.html
    assert "url(" not in page.html
    for picture in page.all("img"):
        assert picture["src"].startswith("data:image/")
        assert picture["alt"]
    for drawing in page.all("svg"):
        assert drawing["aria-label"]
    policy = next(meta["content"] for meta in page.all("meta") if meta.get("http-equiv"))
    assert policy.startswith("default-src 'none'")
