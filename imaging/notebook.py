"""HTML representation for Jupyter: pictures with a caption below each."""

import base64
import html
from collections.abc import Iterable


def gallery(caption: str, pictures: Iterable[tuple[str, bytes]]) -> str:
    """HTML of pictures side by side, each a line of text and the bytes of a PNG or JPEG, below a caption."""
    figures = "".join(
        '<figure style="margin:0 8px 8px 0;max-width:100%">'
        f'<img alt="{html.escape(text)}" style="max-width:100%;display:block" src="{_uri(data)}">'
        f'<figcaption style="font-size:90%">{html.escape(text)}</figcaption></figure>'
        for text, data in pictures
    )
    return (
        f'<div><p style="margin:4px 0">{html.escape(caption)}</p>'
        f'<div style="display:flex;flex-wrap:wrap">{figures}</div></div>'
    )


def _uri(data: bytes) -> str:
    kind = "png" if data.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
