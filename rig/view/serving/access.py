"""Access control: pages of this very server, and, where other machines reach it, holders of its token."""

import functools
import hmac
import http
import logging
import re
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from urllib.parse import parse_qs, urlsplit

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from rig.view.serving.state import said_state
from rig.view.serving.window import (
    css_width,
    is_bright,
    on_hdr_screen,
    state_of,
    width_of,
    with_script,
)

LOCAL = "127.0.0.1"
PARAMETER = "token"
_LOCAL_PAGE = re.compile(r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?")
_REFUSAL = b"This page needs its whole address, token included, as `rig view` printed it.\n"

Answer = Callable[[ServerConnection, Request], Response | None]


@dataclass(frozen=True)
class Access:
    """Token that a browser has to show, in the address and then as a cookie; None: no token."""

    token: str | None = None

    @classmethod
    def to(cls, host: str) -> "Access":
        """Access to a server at an address: a random token, unless only this machine reaches it."""
        local = host in (LOCAL, "localhost", "::1")
        return cls(None if local else secrets.token_urlsafe(24))

    @property
    def query(self) -> str:
        """Query at the end of the page's address."""
        return "" if self.token is None else f"/?{PARAMETER}={self.token}"

    def refusal(self, request: Request) -> Response | None:
        """Return the refusal of a request, or None if it is accepted.

        A program has no origin; a page of somebody else's site has its own, and any browser would let it
        connect. Pages of this machine may, as may those that came from the address that they connect to.
        """
        try:
            return self._refusal(request)
        except (LookupError, ValueError):  # headers given twice, invalid addresses
            return _response(http.HTTPStatus.BAD_REQUEST, b"This request makes no sense.\n")

    def _refusal(self, request: Request) -> Response | None:
        origin, host = request.headers.get("Origin"), request.headers.get("Host", "")
        if origin is not None and not _LOCAL_PAGE.fullmatch(origin) and urlsplit(origin).netloc != host:
            return _response(http.HTTPStatus.FORBIDDEN, b"Pages of other sites are refused.\n")
        if self.token is None and not _LOCAL_PAGE.fullmatch(f"http://{host}"):
            # A name of somebody else's that points here: its pages would be of one origin with these.
            return _response(http.HTTPStatus.FORBIDDEN, b"Only this machine is served, by its own address.\n")
        if self.token is None or self._shown(request):
            return None
        return _response(http.HTTPStatus.FORBIDDEN, _REFUSAL)

    def remembered(self, request: Request, response: Response) -> None:
        """Store the token as a cookie if the address has it."""
        if self.token is not None and self._in_address(request):
            value = f"{_cookie_name(request)}={self.token}; Path=/; HttpOnly; SameSite=Strict"
            response.headers["Set-Cookie"] = value

    def _shown(self, request: Request) -> bool:
        if self._in_address(request):
            return True
        # Not by `http.cookies`: it gives up at cookies that other servers of this machine set their own way.
        pattern = rf"(?:^|;)\s*{re.escape(_cookie_name(request))}=\"?([^;\"\s]*)"
        return any(map(self._is, re.findall(pattern, "; ".join(request.headers.get_all("Cookie")))))

    def _in_address(self, request: Request) -> bool:
        return any(map(self._is, parse_qs(urlsplit(request.path).query).get(PARAMETER, [])))

    def _is(self, text: str) -> bool:
        assert self.token is not None
        return hmac.compare_digest(text.encode(errors="surrogateescape"), self.token.encode())


_UNHEARD = logging.getLogger(f"{__name__}.connections")
"""Logger in which `websockets` writes tracebacks of invalid connections."""
_UNHEARD.propagate = False
_UNHEARD.addHandler(logging.NullHandler())


@contextmanager
def guarded(access: Access) -> Iterator[None]:
    """Servers that are begun in here answer by the rules of `access`.

    viser has no argument for that; `websockets`, with which it serves, has.
    """
    serve = websockets.asyncio.server.serve

    def guarded_serve(*arguments: object, process_request: Answer, **options: object) -> object:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            refused = access.refusal(request)
            if refused is not None:
                return refused
            response = process_request(connection, request)
            if response is None:
                css_width.set(width_of(request))
                on_hdr_screen.set(is_bright(request))
                said_state.set(state_of(request))
                return None
            response = with_script(response)
            access.remembered(request, response)
            return response

        options.setdefault("logger", _UNHEARD)
        return serve(*arguments, process_request=answer, **options)  # type: ignore[arg-type]

    websockets.asyncio.server.serve = functools.wraps(serve)(guarded_serve)  # type: ignore
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore


def _cookie_name(request: Request) -> str:
    """One for each port: a browser keeps cookies by host alone."""
    return "rig_view_" + request.headers.get("Host", "").rpartition(":")[2]


def _response(status: http.HTTPStatus, text: bytes) -> Response:
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(text))})
    return Response(status.value, status.phrase, headers, text)
