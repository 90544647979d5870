"""Requests say how wide their window is, and pages are given the script that says so."""

import gzip

import pytest
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from rig.view.serving.window import width_of, with_script

PAGE = b"<!doctype html><html><head><title>a</title></head><body></body></html>"


@pytest.mark.parametrize(
    ("cookie", "width"),
    [
        ("rig_view_width=420", 420),
        ("rig_view_8080=secret; rig_view_width=1280", 1280),
        ("", None),
        ("other=3", None),
        ("rig_view_width=", None),
        ("rig_view_width=-5", None),
        ("rig_view_width=1e9", None),
        ("rig_view_width=999999999", None),
        ("=;;=rig_view_width", None),
        ('theirs={"a": [1]}; rig_view_width=420', 420),
        ("not_rig_view_width=420", None),
    ],
)
def test_a_width_is_read_or_not_known(cookie: str, width: int | None) -> None:
    assert width_of(Request("/", Headers({"Cookie": cookie}))) == width


@pytest.mark.parametrize("zipped", [False, True])
def test_pages_get_the_script_and_other_files_do_not(zipped: bool) -> None:
    body = gzip.compress(PAGE) if zipped else PAGE
    headers = {"Content-Length": str(len(body)), "Content-Encoding": "gzip" if zipped else "identity"}
    plain = Response(200, "OK", Headers(headers | {"Content-Type": "image/png"}), body)
    assert with_script(plain) is plain
    page = with_script(Response(200, "OK", Headers(headers | {"Content-Type": "text/html"}), body))
    assert page.headers.get_all("Content-Length") == [str(len(page.body))]
    text = gzip.decompress(page.body) if zipped else page.body
    before, style, rest = text.partition(b"\n<style>")
    assert style
    assert before + rest.partition(b"</script>\n")[2] == PAGE
