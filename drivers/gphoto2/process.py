"""A libgphoto2 camera in a separate process, driven over pipes.

libgphoto2 2.5.34 closes file 0 whenever it lets go of a camera on the network, whatever that is by then, and
the package gphoto2 stops all threads for some questions: neither may happen where frames are written.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Concatenate, ParamSpec, TypeVar

from drivers.errors import CameraLost
from drivers.gphoto2.body import Body
from drivers.gphoto2.library import library
from imaging.errors import CameraError

_LEAVE = 5.0
"""Seconds that the process may take to let go of the camera before it is ended."""
_CODE = "import sys; sys.path[:] = {path!r}; from drivers.gphoto2.process import serve; serve()"

P = ParamSpec("P")
R = TypeVar("R")


class BodyProcess:
    """A `Body` elsewhere, for one thread."""

    def __init__(self, model: str, port: str, where: str) -> None:
        """Start as `Body`, with the same errors."""
        library()  # where it is missing, no process need be started to say so
        self._where = where
        code = _CODE.format(path=sys.path)
        # A session of its own, as Ctrl-C is for us to answer, who let go of the camera then.
        self._process = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        try:
            self._ask("__init__", model, port, where)
        except CameraError:
            self.close()
            raise

    def do(self, act: Callable[Concatenate[Body, P], R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Return what that method of the body returns or raises. CameraLost: its process has ended."""
        answer: R = self._ask(act.__name__, *args, **kwargs)  # type: ignore[assignment]
        return answer

    def close(self) -> None:
        """Let go of the camera; a second time does nothing."""
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()
        try:
            self._process.wait(_LEAVE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _ask(self, what: str, *args: object, **kwargs: object) -> object:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            pickle.dump((what, args, kwargs), self._process.stdin)
            self._process.stdin.flush()
            answer: object = pickle.load(self._process.stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
            raise CameraLost(
                f"{self._where} was closed, since libgphoto2 crashed: switch the camera off and on."
            ) from error
        if isinstance(answer, CameraError):
            raise answer
        return answer


def serve() -> None:
    """Answer requests in the other process until the pipe closes."""
    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # whatever a library prints is no answer
    body: Body | None = None
    try:
        while True:
            try:
                what, args, kwargs = pickle.load(questions)
            except EOFError:
                return
            answer: object = None
            try:
                if body is None:
                    body = Body(*args)
                else:
                    answer = getattr(body, what)(*args, **kwargs)
            except CameraError as error:
                answer = error
            pickle.dump(answer, answers)
            answers.flush()
    except BrokenPipeError:
        return
    finally:
        if body is not None:
            body.close()
