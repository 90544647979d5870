"""A GenICam description that is not in the camera: in a file of its maker's software, or a web page."""

import re
import urllib.error
import urllib.parse
import urllib.request
from http.client import HTTPException
from pathlib import Path

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.archive import LARGEST_XML, unzipped

_FILE = re.compile(r"file:(?://)?(?P<path>[^?]*)", re.IGNORECASE)
_SUFFIXES = (".xml", ".zip")
_PATIENCE = 5.0
"""Seconds for an answer of the camera's web server."""


class _NowhereElse(urllib.request.HTTPRedirectHandler):
    """Follows no redirection: the description is read from the camera alone."""

    def redirect_request(self, *question: object) -> None:
        return None


def read_url(url: str, where: str, address: str = "") -> bytes:
    """The XML at a `File:` or `http:` URL, unzipped.

    where: names the camera in messages; address: its IPv4, the only one that is asked by http. CameraRefused:
    it is not there, or elsewhere; CameraProtocol: it is damaged.
    """
    match = _FILE.match(url)
    data = _file(match["path"], where) if match else _page(url, where, address)
    if not data.startswith(b"PK"):
        return data
    try:
        return unzipped(data)
    except CameraProtocol as error:
        raise CameraProtocol(f"{where}: {error} ({url}): install its maker's software again.") from error


def _file(name: str, where: str) -> bytes:
    path = Path(urllib.parse.unquote(name).replace("|", ":"))
    try:
        if path.is_absolute() and path.suffix.lower() in _SUFFIXES and path.is_file():
            if path.stat().st_size <= LARGEST_XML:
                return path.read_bytes()
            raise CameraRefused(
                f"{where}: its description {path} is larger than {LARGEST_XML >> 20} MB: check it."
            )
    except OSError as error:
        raise CameraRefused(
            f"{where}: its description {path} cannot be read ({error.strerror}): allow it, or install its "
            "maker's software again."
        ) from error
    raise CameraRefused(
        f"{where} refers to a description on this host, {str(path)!r}, which does not exist: install its "
        "maker's software, which includes it, or its maker's GenTL producer."
    )


def _page(url: str, where: str, address: str) -> bytes:
    parts = urllib.parse.urlsplit(url)
    if parts.scheme.lower() != "http" or not address or parts.hostname != address:
        raise CameraRefused(
            f"{where} refers to a description at {url!r}, and rig does not load any over the network: use "
            "the camera through its maker's GenTL producer."
        )
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}), _NowhereElse())
    try:
        with opener.open(url, timeout=_PATIENCE) as page:
            data: bytes = page.read(LARGEST_XML + 1)
    except (OSError, HTTPException, ValueError) as error:
        if isinstance(error, urllib.error.HTTPError):
            error.close()  # it is a page as well, which has no place in a message
        raise CameraRefused(
            f"{where} has its description at {url}, where it cannot be read ({error}): restart it, or "
            "use it by its maker's GenTL producer."
        ) from error
    if len(data) > LARGEST_XML:
        raise CameraRefused(
            f"{where}: its description at {url} is larger than {LARGEST_XML >> 20} MB: check it."
        )
    return data
