"""Equations as MathML, made when the site is built: browsers draw it themselves, and nothing is fetched.

`$x$` and `$$x$$` come here as pymdownx.arithmatex marks them.
"""

import re
from html import unescape
from typing import Any

from latex2mathml.converter import convert

MARKED = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">(?:\\\((?P<inline>.*?)\\\)|\\\[(?P<block>.*?)\\\])</(?P=tag)>',
    re.DOTALL,
)


def on_page_content(html: str, **_: Any) -> str:
    """The page's HTML with every equation drawn."""
    return MARKED.sub(_drawn, html)


def _drawn(match: re.Match[str]) -> str:
    inline, block = match["inline"], match["block"]
    if block is None:
        return convert(unescape(inline), display="inline")
    return f'<div class="equation">{convert(unescape(block), display="block")}</div>'
