"""The cameras that can be reached over Ethernet: discovery by broadcast, and at addresses that are named."""

import ipaddress
import select
import socket
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass

import ifaddr

from drivers.errors import CameraProtocol
from drivers.gige import gvcp
from drivers.gige.gvcp import ACKNOWLEDGE, BROADCAST_ANSWER, Answer, Code, Command
from drivers.gige.registers import About

_QUIET, _LONGEST = 0.25, 1.0
"""Seconds without an answer after which no more come, as devices answer within milliseconds; and in all."""
_ROUNDS = 3
"""Times that everybody is asked: datagrams get lost."""


@dataclass(frozen=True)
class Interface:
    """An address of this machine, and the one that reaches all of its subnet."""

    address: str
    broadcast: str


def interfaces() -> tuple[Interface, ...]:
    """The IPv4 addresses of this machine, loopback left out."""
    usable = []
    for adapter in ifaddr.get_adapters():
        for ip in adapter.ips:
            if not isinstance(ip.ip, str) or ipaddress.ip_address(ip.ip).is_loopback:
                continue
            subnet = ipaddress.ip_network(f"{ip.ip}/{ip.network_prefix}", strict=False)
            usable.append(Interface(ip.ip, str(subnet.broadcast_address)))
    return tuple(usable)


class Network:
    """Networks to search: those that a broadcast reaches, and named addresses."""

    def __init__(self, addresses: Sequence[str] = (), broadcast: Sequence[Interface] | None = None) -> None:
        """addresses: IPv4; broadcast: from these addresses, None for all of this machine."""
        self._addresses = tuple(addresses)
        self._broadcast = broadcast

    def discover(self) -> list[About]:
        """Return the devices that answer, in the order of addresses."""
        places = interfaces() if self._broadcast is None else self._broadcast
        answers: dict[str, About] = {}
        if not places and not self._addresses:
            return []
        with ExitStack() as stack:
            sockets: list[tuple[socket.socket, list[str]]] = []
            for place in places:
                link = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                link.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
                with suppress(OSError):  # an address that has just gone
                    link.bind((place.address, 0))
                    sockets.append((link, ["255.255.255.255", place.broadcast]))
            if self._addresses:
                link = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                sockets.append((link, list(self._addresses)))
            for round_ in range(1, _ROUNDS + 1):
                for link, targets in sockets:
                    _ask(link, targets, round_)
                _collect([link for link, _ in sockets], answers, set(self._addresses), bool(places))
                if not places and set(self._addresses) <= set(answers):
                    break
        return sorted(answers.values(), key=lambda about: ipaddress.ip_address(about.address))


def _ask(link: socket.socket, targets: Sequence[str], request_id: int) -> None:
    for target in targets:
        command = Command(Code.DISCOVERY, request_id, flags=ACKNOWLEDGE | BROADCAST_ANSWER)
        with suppress(OSError):  # the network is unreachable: no camera is there
            link.sendto(command.pack(), (target, gvcp.PORT))


def _collect(
    links: Sequence[socket.socket], answers: dict[str, About], named: set[str], everybody: bool
) -> None:
    """Answers until none has come for a while, or until all who were asked by name have answered."""
    deadline = time.monotonic() + _LONGEST
    while (everybody or not named <= set(answers)) and time.monotonic() < deadline:
        ready, _, _ = select.select(links, [], [], _QUIET)
        if not ready:
            return
        for link in ready:
            with suppress(OSError, CameraProtocol):  # what is no answer is of no interest
                data, (address, _) = link.recvfrom(2048)
                answer = Answer.parse(data)
                if answer.code == Code.DISCOVERY_ACK and answer.status == 0:
                    answers.setdefault(address, About.parse(answer.payload, address))
