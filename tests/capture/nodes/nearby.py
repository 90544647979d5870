"""Nodes in this process: all that Ray would carry is pickled, and what goes wrong is written down."""

import pickle
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from capture.nodes.node import Assignment, Node
from capture.nodes.node_settings import Place
from drivers.clock import Clock
from drivers.errors import HostLost
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Mix
from drivers.sim.jumping_clock import JumpingClock
from drivers.sim.rigs import simulate
from drivers.sim.usb.timeline import Timeline


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
            raise HostLost("node near does not answer")
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
    jumps: Sequence[tuple[float, float]] = (),
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
        return Node(
            Place(name, bus.backend, JumpingClock(clock, ahead, jumps), disk / name, rig=rig), assignment
        )

    return NearLink(make, clock, there, back)
