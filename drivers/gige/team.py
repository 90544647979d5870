"""Cameras that one command triggers together, as the ones that take part see it."""

import threading

from drivers.gige.actions import NetworkTime


class ActionTeam:
    """Made once for a rig, and joined by each of its cameras; for any thread.

    time: the time that the cameras share, once they do.
    """

    def __init__(self) -> None:
        self.time = NetworkTime()
        self._addresses: dict[str, str] = {}
        self._synchronised: dict[str, bool] = {}
        self._lock = threading.Lock()

    def note(self, serial: str, address: str, *, synchronised: bool) -> None:
        """Record a camera's address, and whether it keeps the common time."""
        with self._lock:
            self._addresses[serial], self._synchronised[serial] = address, synchronised

    @property
    def addresses(self) -> tuple[str, ...]:
        """Addresses of all cameras."""
        with self._lock:
            return tuple(self._addresses.values())

    @property
    def synchronised(self) -> bool:
        """True if all cameras keep one time."""
        with self._lock:
            return bool(self._synchronised) and all(self._synchronised.values())
