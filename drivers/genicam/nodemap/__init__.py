"""A small GenApi: the features that a camera's GenICam XML describes, over its memory."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.nodemap.description import read_description
from drivers.genicam.nodemap.formula import Number
from drivers.genicam.nodemap.formulas import Converter, SwissKnife
from drivers.genicam.nodemap.nodes import Limits, Memory, Node, Surroundings, Value, numeric
from drivers.genicam.nodemap.registers import (
    FloatRegister,
    IntRegister,
    MaskedIntRegister,
    StringRegister,
)
from drivers.genicam.nodemap.values import Boolean, Command, Enumeration, Float, Integer, String

__all__ = ["Limits", "Memory", "NodeMap"]

_KINDS: dict[str, type[Node]] = {
    "Boolean": Boolean,
    "Command": Command,
    "Converter": Converter,
    "Enumeration": Enumeration,
    "Float": Float,
    "FloatReg": FloatRegister,
    "IntConverter": Converter,
    "IntReg": IntRegister,
    "IntSwissKnife": SwissKnife,
    "Integer": Integer,
    "MaskedIntReg": MaskedIntRegister,
    "String": String,
    "StringReg": StringRegister,
    "SwissKnife": SwissKnife,
}


class NodeMap:
    """A camera's features by name.

    Nothing is kept from one question to the next: each is answered by the device as it is then. Errors:
    CameraRefused where the device does not have the feature or does not allow or take the value,
    CameraProtocol where its description makes no sense, both with the feature's name; those of the memory
    as they are.
    """

    def __init__(self, xml: bytes, memory: Memory, where: str) -> None:
        """`where` names the camera in messages; `vendor` is its maker, as the description has it."""
        self.where = where
        self._around = Surroundings(self._find, memory)
        with self._about("the description"):
            self.vendor, self._elements = read_description(xml)
        self._nodes: dict[str, Node] = {}

    def names(self) -> tuple[str, ...]:
        """All nodes, features and what is behind them."""
        return tuple(self._elements)

    def features(self, category: str = "Root") -> tuple[str, ...]:
        """Features and subcategories of a Category, in order; () for an unknown one."""
        names: list[str] = []
        waiting = [category]
        while waiting:
            element = self._elements.get(waiting.pop(0))
            if element is None or element.name in names:
                continue
            names.append(element.name)
            if element.tag == "Category":
                waiting += [child.text for child in element.all("pFeature")]
        return tuple(name for name in names if self._elements[name].tag != "Category")

    def available(self, name: str) -> bool:
        """Return whether the feature is described, implemented and there at the moment."""
        with self._about(name):
            return name in self._elements and self._find(name).available()

    def writable(self, name: str) -> bool:
        """Return whether it is available and may be set at the moment."""
        with self._about(name):
            return name in self._elements and "W" in self._find(name).access()

    def number(self, name: str) -> Number:
        """The value of a numeric feature; of an Enumeration its number, of a Boolean 1 or 0."""
        with self._about(name):
            return numeric(self._readable(name).get())

    def text(self, name: str) -> str:
        """The entry that an Enumeration is at, or the text of a string."""
        with self._about(name):
            node = self._readable(name)
            return node.name() if isinstance(node, Enumeration) else str(node.get())

    def entries(self, name: str) -> tuple[str, ...]:
        """Return what an Enumeration can be set to at the moment; () for other nodes and unknown ones."""
        with self._about(name):
            node = self._find(name) if name in self._elements else None
            return tuple(node.entries()) if isinstance(node, Enumeration) else ()

    def limits(self, name: str) -> Limits:
        """Return where a number may be at the moment."""
        with self._about(name):
            return self._find(name).limits()

    def kind(self, name: str) -> str:
        """Node type in the description, such as Float or Enumeration; empty for an unknown node."""
        return self._elements[name].tag if name in self._elements else ""

    def unit(self, name: str) -> str:
        """The unit of a number that the description states; empty where it states none."""
        with self._about(name):
            return self._find(name).unit()

    def set_nearest(self, name: str, value: float) -> None:
        """Set a number to the value that is nearest of those which the camera takes."""
        with self._about(name):
            node = self._writable(name)
            node.set(node.limits().nearest(value, whole=node.whole))

    def set(self, name: str, value: Value) -> None:
        """Set a number, a bool, a text, or an Enumeration by the name of its entry."""
        with self._about(name):
            if isinstance(value, float) and not math.isfinite(value):
                raise CameraRefused(f"{value} is no finite number: give another value")
            self._writable(name).set(value)

    def execute(self, name: str) -> None:
        """Carry out a Command."""
        with self._about(name):
            self._command(name).execute()

    def done(self, name: str) -> bool:
        """Return whether a Command is finished."""
        with self._about(name):
            return self._command(name).done()

    def attach_chunks(self, chunks: dict[int, bytes]) -> None:
        """The chunks of the frame whose Chunk... features are to be read, by ChunkID."""
        self._around.chunks = chunks

    def _find(self, name: str) -> Node:
        node = self._nodes.get(name)
        if node is None:
            element = self._elements.get(name)
            if element is None:
                raise CameraRefused(f"there is no {name}")
            node = self._nodes[name] = _KINDS.get(element.tag, Node)(element, self._around)
        return node

    def _readable(self, name: str) -> Node:
        node = self._find(name)
        if "R" not in node.access():
            raise CameraRefused("it cannot be read as the camera is set up")
        return node

    def _writable(self, name: str) -> Node:
        node = self._find(name)
        if "W" not in node.access():
            raise CameraRefused("it cannot be set as the camera is set up")
        return node

    def _command(self, name: str) -> Command:
        node = self._writable(name)
        if not isinstance(node, Command):
            raise CameraProtocol(f"it is a {node.element.tag}, no Command")
        return node

    @contextmanager
    def _about(self, name: str) -> Iterator[None]:
        """A question to the device, whose errors name the camera and the feature."""
        self._around.values.clear()
        try:
            yield
        except (CameraProtocol, CameraRefused) as error:
            kind = CameraRefused if isinstance(error, CameraRefused) else CameraProtocol
            message = str(error).removeprefix(self.where).lstrip(": ")
            raise kind(f"{self.where}: {name}: {message}") from error
        except RecursionError:
            raise CameraProtocol(f"{self.where}: {name} depends on itself: update the firmware.") from None
