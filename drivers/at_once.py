"""Calls that wait for devices, made side by side: a camera that does not answer holds no other one up."""

import threading
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

T = TypeVar("T")


class Call(Generic[T]):
    """A call in a thread of its own, which ends with the process, begun at once."""

    def __init__(self, function: Callable[[], T]) -> None:
        self._function = function
        self._result: T
        self._error: BaseException | None = None
        # A daemon: Ctrl-C must not wait for a camera that somebody is to confirm a connection on.
        self._thread = threading.Thread(target=self._run, name="call", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._result = self._function()
        except BaseException as error:  # raised by `result`, in the thread that asks
            self._error = error

    def result(self) -> T:
        """Wait for the call; return what it returned, or raise what it raised."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._result


def all_at_once(functions: Iterable[Callable[[], T]]) -> list[T]:
    """Return the results of calls, in order; raises the first error."""
    calls = [Call(function) for function in functions]
    return [call.result() for call in calls]
