"""Nodes in this process: all that Ray would carry is pickled, and what goes wrong is written down."""

import pickle
from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from capture.nodes.node import Assignment, Node
from capture.nodes.node_settings import Place
from capture.nodes.remote import NodeLost
from drivers.clock import Clock
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Mix
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import Timeline


class AheadClock:
    """A clock that is ahead of another, which keeps the time."""

    def __init__(self, clock: Clock, ahead: float) -> None:
        self._clock, self._ahead = clock, ahead

    @property
    def lock(self) -> AbstractContextManager[object]:
        return self._clock.lock

    def now(self) -> float:
        return self._clock.now() + self._ahead

    def sleep(self, seconds: float) -> None:
        self._clock.sleep(seconds)

    def wait(self, ready: Callable[[], bool], seconds: float) -> bool:
        return self._clock.wait(ready, seconds)

    def changed(self) -> None:
        self._clock.changed()

    def worker(self, name: str) -> AbstractContextManager[object]:
        return self._clock.worker(name)


class NearLink:
    """The way to a node: there and back again take so many seconds of the clock.

    make: the node, anew where it is started again. dies_at: of which question nobody answers any more.
    damaged: files whose first readings come with a bit turned.
    """

    def __init__(self, make: Callable[[], Node], clock: Clock, there: float = 0.0, back: float = 0.0) -> None:
        self._make, self._clock, self._there, self._back = make, clock, there, back
        self.node = make()
        self.asked: Counter[str] = Counter()
        self.dies_at: tuple[str, int] | None = None
        self.damaged = 0
        self.dead = False

    def ask(self, what: str, *arguments: Any) -> Any:
        self.asked[what] += 1
        if self.dies_at == (what, self.asked[what]):
            self.dead = True
        if self.dead:
            raise NodeLost("node near does not answer")
        question = pickle.loads(pickle.dumps(arguments))
        self._pass(self._there)
        answer = pickle.loads(pickle.dumps(getattr(self.node, what)(*question)))
        self._pass(self._back)
        if what == "read" and self.damaged:
            self.damaged -= 1
            return bytes([answer[0] ^ 1]) + answer[1:]
        return answer

    def start_again(self) -> None:
        """Lose what it had in memory."""
        self.node, self.dead, self.dies_at = self._make(), False, None

    def close(self) -> None:
        if not self.dead:
            self.node.close()

    def _pass(self, seconds: float) -> None:
        if seconds:
            self._clock.sleep(seconds)


def near_node(
    name: str,
    assignment: Assignment,
    clock: Timeline,
    disk: Path,
    *,
    ahead: float = 0.0,
    there: float = 0.0,
    back: float = 0.0,
    seed: int = 3,
    model: str = "generic",
    mix: Mix | None = None,
    **changes: Any,
) -> NearLink:
    """The way to a node with simulated cameras of the rig toy, on a timeline that all share."""

    def make() -> Node:
        rig = simulate("toy", seed, samples=1, **changes)
        bus = BusRig(rig, mix=mix, model=model, clock=clock)
        return Node(Place(name, bus.backend, AheadClock(clock, ahead), disk / name, rig=rig), assignment)

    return NearLink(make, clock, there, back)
