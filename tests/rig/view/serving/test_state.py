"""The state of a page as the text of an address."""

import html
from urllib.parse import quote

import pytest
from websockets.datastructures import Headers
from websockets.http11 import Request

from rig.view.pictures.look import Look
from rig.view.serving.start_view import Start
from rig.view.serving.state import State
from rig.view.serving.window import state_of

STATES = [
    State(),
    State(Look(-2.5, "false colour"), "0003/cam 1&2", "A | B"),
    State(view="0003/cam1", centre=(0.25, 1.0)),
    State(
        Look(3.0, "AgX"),
        show="depth",
        start=Start((1.25, -2.5, 3.0), (0.0, 0.0, 1e-3), (0.0, -1.0, 0.0), 0.9),
    ),
]


@pytest.mark.parametrize("state", STATES)
def test_a_state_comes_back(state: State) -> None:
    assert State.of(state.text, Look()) == state
    request = Request(
        "/", Headers({"Host": "127.0.0.1:8080", "Cookie": f"a=b; rig_view_state_8080={quote(state.text)}"})
    )
    assert State.of(state_of(request), Look()) == state
    assert html.unescape(state.element).count(state.text) == 1


@pytest.mark.parametrize(
    "text",
    [
        "",
        "stops=nan&tones=loud",
        "stops=17",
        "stops=1e999",
        "stops=1 2",
        "position=1 2 3&look_at=1 2 3&up=0 0 1&fov=1",
        "position=1 2&look_at=0 0 0&up=0 0 1&fov=1",
        "position=1 2 inf&look_at=0 0 0&up=0 0 1&fov=1",
        "position=1 2 3&look_at=0 0 0&up=0 0 0&fov=1",
        "position=1 2 3&look_at=0 0 0&up=0 0 1&fov=9",
        "position=1 2 3&look_at=0 0 0&up=0 0 1&fov=0",
        "centre=0.5 1.5",
        "centre=-0.5 0.5",
        "centre=0.5",
        "%%%&&&==",
        "\xff",
    ],
)
def test_what_makes_no_sense_is_left_out(text: str) -> None:
    assert State.of(text, Look()) == State()


@pytest.mark.parametrize("host", ["127.0.0.1:8081", "localhost", "[::1]", ""])
def test_the_address_of_another_server_is_not_this_ones(host: str) -> None:
    headers = Headers({"Host": host, "Cookie": "rig_view_state_8080=stops%3D1"})
    assert state_of(Request("/", headers)) == ""
