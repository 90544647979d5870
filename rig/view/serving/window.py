"""A browser's window: its width in CSS pixels, its address, and our part of viser's page: its first moments,
taps, the address.
"""

import functools
import gzip
import re
from contextvars import ContextVar
from dataclasses import dataclass
from urllib.parse import unquote

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from rig.view.serving.state import ELEMENT

HERE = "rig-here"
"""Element of the page that is there as soon as a browser has our panel."""
BRIGHT = "rig-bright"
"""Element of the page whose data is an AVIF for an HDR screen, which lies over the picture."""
_COOKIE, _STATE, _HDR = "rig_view_width", "rig_view_state", "rig_view_hdr"
_SAID = re.compile(rf"(?:^|;)\s*{_COOKIE}=([0-9]{{1,5}})\s*(?:;|$)")
# viser leaves a pointer alone that an element has captured. Browsers capture those of fingers and pens by
# themselves for what they touch, so that no tap would ever measure. It connects to the address of the page,
# which must have nothing behind its # then: that comes back with the first picture.
# Cookies are of all windows alike: each window writes its own just before it connects, which viser lets a
# worker do, first and after the server was away.
# On slow browsers viser draws fewer pixels than the screen has, unless its address names the ratio when it
# begins: a view pixel for pixel would be resampled.
# Until our panel is there, its place has viser's own settings, on white.
_SCRIPT = f"""<style>
html, html:not(.{HERE}) body {{ background: #181818 !important }}
html:not(.{HERE}) #root {{ visibility: hidden }}
html:not(.{HERE}) body::before {{
  content: "Connecting"; position: fixed; inset: 45% 0 auto; text-align: center; color: #bbb;
  font: 16px sans-serif;
}}
#{BRIGHT}-shown {{ position: absolute; inset: 0; width: 100%; height: 100%; pointer-events: none;
  dynamic-range-limit: no-limit; }}
</style>
<script>
const ours = () => document.documentElement.classList.add("{HERE}");
setTimeout(ours, 15000);
const high = matchMedia("(dynamic-range: high)");
let state = location.hash.slice(1);
const say = () => {{
  document.cookie = `{_COOKIE}=${{innerWidth}}; Path=/; SameSite=Strict`;
  document.cookie = `{_HDR}=${{Number(high.matches)}}; Path=/; SameSite=Strict`;
  document.cookie = `{_STATE}_${{location.port}}=${{encodeURIComponent(state)}}; Path=/; SameSite=Strict`;
}};
const post = Worker.prototype.postMessage;
Worker.prototype.postMessage = function (message, ...rest) {{
  if (["set_server", "retry"].includes(message?.type)) say();
  return post.call(this, message, ...rest);
}};
const asked = new URLSearchParams(location.search);
asked.delete("fixedDpr");
const address = location.pathname + (`${{asked}}` && `?${{asked}}`);
asked.set("fixedDpr", devicePixelRatio);
history.replaceState(null, "", location.pathname + "?" + asked);
matchMedia(`(resolution: ${{devicePixelRatio}}dppx)`).addEventListener("change", () => location.reload());
high.addEventListener("change", () => location.reload());
const bright = Object.assign(new Image(), {{ id: "{BRIGHT}-shown", alt: "" }});
const cover = () => {{
  const data = document.getElementById("{BRIGHT}")?.dataset;
  if (data?.number === bright.dataset.number) return;
  bright.remove();
  bright.dataset.number = data?.number ?? "";
  if (!data?.avif) return;
  bright.src = "data:image/avif;base64," + data.avif;
  document.querySelector("canvas[data-engine]").after(bright);
}};
addEventListener("hashchange", () => location.reload());
new MutationObserver(() => {{
  if (document.getElementById("{HERE}")) setTimeout(ours, 300); // in which viser folds its settings away
  cover();
  const said = document.getElementById("{ELEMENT}")?.title;
  if (said === undefined || "#" + said === location.hash) return;
  history.replaceState(null, "", address + "#" + said);
  state = location.hash.slice(1);
}}).observe(document, {{ subtree: true, childList: true, attributeFilter: ["title"] }});
addEventListener("pointerdown", (event) => {{
  const {{ target, pointerId }} = event;
  if (target instanceof HTMLCanvasElement && target.hasPointerCapture(pointerId))
    target.releasePointerCapture(pointerId);
}}, true);
</script>
"""

css_width: ContextVar[int | None] = ContextVar("css_width", default=None)
"""Window width, px, of the present connection, or None."""
on_hdr_screen: ContextVar[bool] = ContextVar("on_hdr_screen", default=False)
"""True if the window of the present connection is on an HDR screen."""


@dataclass(frozen=True)
class Window:
    """narrow: all controls would hide the picture; bright: on an HDR screen."""

    narrow: bool = False
    bright: bool = False


def width_of(request: Request) -> int | None:
    """Read the width of the window, CSS px, that a request is from, or None."""
    # Not by `http.cookies`: it gives up at cookies that other servers of this machine set in their own way.
    match = _SAID.search("; ".join(request.headers.get_all("Cookie")))
    return int(match[1]) if match else None


def is_bright(request: Request) -> bool:
    """Return whether the window that a request is from is on an HDR screen."""
    cookies = "; ".join(request.headers.get_all("Cookie"))
    return re.search(rf"(?:^|;)\s*{_HDR}=1\s*(?:;|$)", cookies) is not None


def state_of(request: Request) -> str:
    """Read what the address of the window has behind its #, that a request is from; "": nothing."""
    match = re.search(r":([0-9]+)$", request.headers.get("Host", ""))
    port = match[1] if match else ""
    pattern = rf"(?:^|;)\s*{_STATE}_{port}=([^;\s]{{0,2000}})\s*(?:;|$)"
    match = re.search(pattern, "; ".join(request.headers.get_all("Cookie")))
    return unquote(match[1]) if match else ""


def with_script(response: Response) -> Response:
    """Add the script to a page; anything else is as it was."""
    if not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    body = _with_script(bytes(response.body), zipped)
    headers = Headers(response.headers)
    del headers["Content-Length"]
    headers["Content-Length"] = str(len(body))
    return Response(response.status_code, response.reason_phrase, headers, body)


@functools.lru_cache(maxsize=2)
def _with_script(body: bytes, zipped: bool) -> bytes:
    page = gzip.decompress(body) if zipped else body
    page = page.replace(b"<head>", b"<head>\n" + _SCRIPT.encode(), 1)
    return gzip.compress(page) if zipped else page
