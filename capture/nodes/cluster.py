"""Nodes on a Ray cluster: an actor on each, made by the host that leads and gone with it."""

import os
import socket
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

from capture.nodes.node import Assignment, Node
from capture.nodes.node_settings import place_of, settings_here
from capture.nodes.token import ASKS, MODE, ask_for_token, has_token, token_file
from drivers.errors import HostLost
from imaging.errors import CaptureError, InputError

PATIENCE = 5.0
"""Seconds in which a cluster has to answer."""
RELEASED = 20.0
"""Seconds after which a node whose leader was killed is free again, and a host that is down not counted."""
STARTED = 60.0
"""Seconds in which an actor has to begin; rig has to be loaded there."""
AT_ONCE = 64
"""Questions that a node works on at a time: as many cameras."""


HEAD = f"{MODE}={ASKS} ray start --head"
"""Command that starts a cluster with tokens."""


def resource_of(name: str) -> str:
    """The resource of a Ray cluster that a node brings, one of it: it serves one capture at a time."""
    return f"rig-node:{name}"


class ServedNode(Node):
    """The node that this process runs on."""

    def __init__(self, assignment: Assignment) -> None:
        super().__init__(place_of(settings_here()), assignment)


def require_ray() -> Any:
    """The module. InputError: it is not installed."""
    try:
        import ray
    except ImportError:
        raise InputError("Ray is not installed: pip install -e '.[cluster]'.") from None
    return ray


@contextmanager
def joined(address: str) -> Iterator[Any]:
    """Ray, connected with a cluster until the block ends, by this host's token where it has one.

    InputError: it is not there, or wants another token.
    """
    if has_token():
        ask_for_token(os.environ)
    ray = require_ray()
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent
    try:
        require_answer(address)
    except OSError as error:
        raise _nobody(address, error) from None
    try:
        ray.init(address, log_to_driver=False, logging_level="ERROR")
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        refused = isinstance(error, ConnectionError) and "Failed to connect" in str(error)
        if not refused and type(error).__name__ != "AuthenticationError":
            raise _nobody(address, error) from None
        raise InputError(
            f"The Ray cluster at {address} does not admit this host: copy {token_file()} of a host where "
            "rig node runs to the same place here."
        ) from None
    try:
        yield ray
    finally:
        ray.shutdown()


def _nobody(address: str, error: Exception) -> InputError:
    what = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
    return InputError(f"No Ray cluster answers at {address} ({what}): begin one with {HEAD}.")


def require_answer(address: str) -> None:
    """OSError unless somebody listens at HOST:PORT: Ray itself would ask for minutes."""
    host, separator, port = address.removeprefix("ray://").rpartition(":")
    if separator and port.isdecimal():
        socket.create_connection((host, int(port)), timeout=PATIENCE).close()


class RayLink:
    """The way to a node: its actor, which begins anew where the node comes back."""

    def __init__(self, ray: Any, name: str, assignment: Assignment) -> None:
        self._ray, self._name = ray, name
        self._actor = (
            ray.remote(ServedNode)
            .options(
                num_cpus=0,
                resources={resource_of(name): 1},
                max_concurrency=AT_ONCE,
                max_restarts=-1,
                max_task_retries=0,  # a shutter is not to be opened twice
            )
            .remote(assignment)
        )

    def ask(self, what: str, *arguments: Any) -> Any:
        """Ask as `Link.ask`."""
        return self._answer(getattr(self._actor, what).remote(*arguments), None)

    def begin(self) -> None:
        """Start the actor. CaptureError if it does not."""
        try:
            self._answer(self._actor.now.remote(), STARTED)
        except (HostLost, self._ray.exceptions.GetTimeoutError):
            raise CaptureError(
                f"node {self._name} did not begin within {STARTED:g} s: start rig node {self._name} again."
            ) from None

    def close(self) -> None:
        """Close as `Link.close`."""
        with suppress(HostLost, self._ray.exceptions.GetTimeoutError):
            self._answer(self._actor.close.remote(), RELEASED)
        self._ray.kill(self._actor)

    def _answer(self, reference: Any, seconds: float | None) -> Any:
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference, timeout=seconds)
        except errors.RayTaskError as error:
            raise error.cause from None
        except errors.GetTimeoutError:
            raise
        except errors.RayError:
            raise HostLost(
                f"node {self._name} does not answer (its process, its host or the network is down)"
            ) from None


@contextmanager
def ray_links(address: str, assignments: Mapping[str, Assignment]) -> Iterator[dict[str, RayLink]]:
    """The way to each node of a cluster by its name; all have begun.

    InputError: no such cluster. CaptureError: a node is not there, or serves another capture.
    """
    with joined(address) as ray, ExitStack() as stack:
        for name in assignments:
            _require_node(ray, address, name)
        links = {}
        for name, assignment in assignments.items():
            links[name] = RayLink(ray, name, assignment)
            stack.callback(links[name].close)
        for link in links.values():
            link.begin()
        yield links


def _require_node(ray: Any, address: str, name: str) -> None:
    """Raise CaptureError unless exactly one host is that node, and it is free.

    The check is repeated for a while: the cluster notices a dead host or leader only after some seconds.
    """
    resource, deadline, waiting = resource_of(name), time.monotonic() + RELEASED, threading.Event()
    while True:
        hosts = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        count = sum(resource in resources for resources in hosts)
        if count == 1 and ray.available_resources().get(resource):
            return
        if count == 0 or time.monotonic() > deadline:
            break
        waiting.wait(0.2)
    if count == 1:
        raise CaptureError(f"node {name} serves another capture: wait for its end, or stop it.")
    if count > 1:
        raise CaptureError(f"{count} hosts call themselves node {name}: end rig node on all but one.")
    every, head = {one for host in hosts for one in host}, resource_of("")
    others = ", ".join(sorted(one.removeprefix(head) for one in every if one.startswith(head)))
    raise CaptureError(
        f"the Ray cluster at {address} has no node {name} (it has {others or 'none'}): "
        f"start rig node {name} on its host."
    )
