"""Access control over loopback: by a client that we did not write."""

import socket
from collections.abc import Iterator
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
import viser
import websockets.sync.client

from imaging.errors import InputError
from rig.view.serving.access import Access
from rig.view.serving.server import Viewer


@pytest.fixture(scope="module")
def open_to_all() -> Iterator[Viewer]:
    """Serve as on an address that other machines reach."""
    with Viewer("toy", 0, host="0.0.0.0") as running:
        yield running


def connect(viewer: Viewer, query: str = "", **options: object) -> None:
    address = f"ws://127.0.0.1:{viewer.server.get_port()}{query}"
    protocols = [websockets.Subprotocol(f"viser-v{viser.__version__}")]
    websockets.sync.client.connect(address, subprotocols=protocols, **options).close()


def got(viewer: Viewer, path: str, **headers: str) -> tuple[int, str]:
    """Status of the answer, and the cookie that it sets."""
    request = Request(f"http://127.0.0.1:{viewer.server.get_port()}{path}", headers=headers)
    try:
        with urlopen(request) as answer:
            return answer.status, answer.headers.get("Set-Cookie", "")
    except HTTPError as error:
        with error:
            return error.code, error.headers.get("Set-Cookie", "")


REFUSED = pytest.raises(websockets.exceptions.InvalidStatus, match="403")


def test_pages_of_other_sites_are_refused(viewer: Viewer) -> None:
    assert viewer.url == f"http://127.0.0.1:{viewer.server.get_port()}"
    assert viewer.server.get_host() == "127.0.0.1"
    connect(viewer)
    connect(viewer, origin=viewer.url)
    connect(viewer, origin="http://localhost:1234")
    for stranger in ("http://example.org", "http://localhost.example.org", "https://127.0.0.1.example.org"):
        with REFUSED:
            connect(viewer, origin=stranger)


def test_a_name_of_others_that_points_here_is_refused(viewer: Viewer) -> None:
    """Its pages would be of one origin with ours."""
    assert got(viewer, "/", Host="localhost:8080")[0] == 200
    assert got(viewer, "/", Host="example.org")[0] == 403
    assert got(viewer, "/", Host="example.org", Origin="http://example.org")[0] == 403


def test_a_page_that_others_reach_wants_its_token(open_to_all: Viewer) -> None:
    query = open_to_all.url.partition("/?")[2]
    token = query.removeprefix("token=")
    assert len(token) >= 32
    assert token != Access.to("0.0.0.0").token
    for path in ("/", "/index.html", "/?token=", f"/?token={token[:-1]}", "/?token=%00", f"/{token}"):
        assert got(open_to_all, path)[0] == 403
    status, cookie = got(open_to_all, f"/?{query}")
    assert status == 200
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    shown = cookie.partition(";")[0]
    assert got(open_to_all, "/", Cookie=shown)[0] == 200
    assert got(open_to_all, "/", Cookie=shown[:-1])[0] == 403
    with REFUSED:
        connect(open_to_all)
    other = "y" if shown.endswith("x") else "x"
    with REFUSED:
        connect(open_to_all, additional_headers={"Cookie": f"{shown[:-1]}{other}"})
    connect(open_to_all, additional_headers={"Cookie": shown})
    connect(open_to_all, f"/?{query}")
    with REFUSED:
        connect(open_to_all, f"/?{query}", origin="http://example.org")


@pytest.mark.parametrize("host", ["192.0.2.1", "no such name", "192.168..1"])
def test_an_address_of_others_is_told(host: str) -> None:
    with pytest.raises(InputError, match=f"{host} is not an address of this machine"):
        Viewer("toy", 0, host=host)


@pytest.mark.parametrize(
    "beside",
    [
        'theirs="a;b',
        "of/theirs=1",
        "[theirs]={1, 2}",
        "=",
        "; ;;",
        "theirs",
        "\xe9=\xff",
        "rig_view_=x",
        "rig_view_1=" + "y" * 32,
    ],
)
def test_cookies_of_others_are_no_obstacle(open_to_all: Viewer, beside: str) -> None:
    cookie = got(open_to_all, f"/?{open_to_all.url.partition('/?')[2]}")[1].partition(";")[0]
    for cookies in (f"{beside}; {cookie}", f"{cookie}; {beside}"):
        assert got(open_to_all, "/", Cookie=cookies)[0] == 200
    assert got(open_to_all, "/", Cookie=beside)[0] == 403
    name, token = cookie.split("=")
    assert got(open_to_all, "/", Cookie=f'{name}="{token}"')[0] == 200
    assert got(open_to_all, "/", Cookie=f"{name}=\xff; {cookie}")[0] == 200
    assert got(open_to_all, "/", Cookie=f"no_{cookie}")[0] == 403


@pytest.mark.parametrize(
    ("line", "headers", "status"),
    [
        ("/", ["Cookie: a=1", "Cookie: {own}"], 200),
        ("/", ["Cookie: {own}", "Host: example.org"], 400),
        ("//[", ["Cookie: {own}"], 400),
        ("/", ["Cookie: {own}", "Origin: http://["], 400),
        ("/?token=\xff", ["A: b"], 403),
    ],
)
def test_a_request_that_makes_no_sense_is_answered(
    open_to_all: Viewer, line: str, headers: list[str], status: int
) -> None:
    cookie = got(open_to_all, f"/?{open_to_all.url.partition('/?')[2]}")[1].partition(";")[0]
    port = open_to_all.server.get_port()
    text = "\r\n".join([f"GET {line} HTTP/1.1", f"Host: 127.0.0.1:{port}", *headers, "", ""])
    with socket.create_connection(("127.0.0.1", port)) as link:
        link.settimeout(5.0)
        link.sendall(text.format(own=cookie).encode("latin-1"))
        assert link.recv(12).decode() == f"HTTP/1.1 {status}"
