"""The token of a user's Ray clusters: who does not have it cannot connect.

Ray has tokens since 2.52 and asks for none unless RAY_AUTH_MODE says so; it reads them from RAY_AUTH_TOKEN,
or from the file that RAY_AUTH_TOKEN_PATH names, or from ~/.ray/auth_token.
"""

import os
import secrets
import subprocess
import sys
from collections.abc import MutableMapping
from contextlib import suppress
from pathlib import Path

from imaging.errors import InputError
from imaging.files import store

MODE = "RAY_AUTH_MODE"
ASKS = "token"
"""The mode in which Ray asks for the token, and shows it."""
_GIVEN, _PATH = "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"
_MODES = (ASKS, "disabled")
_ANSWERS = 6.0
"""Seconds in which a cluster that asks for no token says that it is well."""


def token_file() -> Path:
    """Return where this user's token is, or will be."""
    return Path(os.environ.get(_PATH) or "~/.ray/auth_token").expanduser()


def has_token() -> bool:
    """Return whether this host has one."""
    with suppress(OSError):
        return bool(os.environ.get(_GIVEN) or token_file().read_text().strip())
    return False


def ask_for_token(environment: MutableMapping[str, str]) -> bool:
    """Enable Ray's token authentication, unless RAY_AUTH_MODE is set; return whether it is on.

    It takes effect in processes that import Ray afterwards. InputError: a mode that Ray does not have.
    """
    mode = environment.setdefault(MODE, ASKS)
    if mode not in _MODES:
        raise InputError(f"RAY_AUTH_MODE is {mode!r}: unset it, or set it to {' or '.join(_MODES)}.")
    return mode == ASKS


def make_token() -> Path | None:
    """Make a token that its owner alone can read; where it is, or None if this host has one.

    StorageError: it cannot be written.
    """
    path = token_file()
    if has_token():
        if _GIVEN not in os.environ:
            with suppress(OSError):  # somebody else's, who let us read it
                path.chmod(0o600)
        return None
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # an empty one, with whatever mode
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_hex(32))
    except OSError as error:
        raise store.refused(path, error) from error
    return path


class OpenDoor:
    """Tries meanwhile whether a cluster lets in who has no token."""

    def __init__(self, address: str) -> None:
        """address: HOST:PORT, where somebody answers."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "ray.scripts.scripts", "health-check", "--address", address],
            env=os.environ | {MODE: "disabled"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def is_open(self) -> bool:
        """Return whether it did; one that asks for tokens never answers such a question with yes."""
        try:
            return self._process.wait(_ANSWERS) == 0
        except subprocess.TimeoutExpired:
            return False
        finally:
            self.close()

    def close(self) -> None:
        """Stop trying."""
        self._process.kill()
        self._process.wait()
