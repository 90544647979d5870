"""GenICam XML read into elements by node name, without entities, document types or code."""

from dataclasses import dataclass, field, replace
from xml.parsers import expat

from drivers.errors import CameraProtocol

_LARGEST, _DEEPEST = 32 << 20, 50


@dataclass(frozen=True)
class Element:
    """An XML element: tag without prefix, attributes, text without surrounding blanks, children."""

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    children: tuple["Element", ...] = ()

    @property
    def name(self) -> str:
        """The attribute Name."""
        return self.attributes.get("Name", "")

    def all(self, tag: str) -> list["Element"]:
        """The children with that tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> str | None:
        """The text of the first child with that tag."""
        return next((child.text for child in self.children if child.tag == tag), None)


def read_description(xml: bytes) -> tuple[str, dict[str, Element]]:
    """Read the maker and the nodes, by name, of a RegisterDescription.

    CameraProtocol for another root or with a document type. The entries of a StructReg are nodes like any
    other, MaskedIntRegs that inherit from the StructReg.
    """
    root = _parse(xml)
    if root.tag != "RegisterDescription":
        raise CameraProtocol(f"the camera's description is a {root.tag!r}, no RegisterDescription")
    nodes: dict[str, Element] = {}
    groups = [root]
    while groups:
        for child in groups.pop().children:
            if child.tag == "Group":
                groups.append(child)
            elif child.tag == "StructReg":
                nodes.update({entry.name: entry for entry in _entries(child)})
            elif child.name:
                nodes[child.name] = child
    return root.attributes.get("VendorName", "").replace("_", " "), nodes


def _entries(structure: Element) -> list[Element]:
    shared = tuple(child for child in structure.children if child.tag != "StructEntry")
    return [
        # What an entry says itself comes first, and the first of a kind counts.
        replace(entry, tag="MaskedIntReg", children=entry.children + shared)
        for entry in structure.all("StructEntry")
    ]


def _parse(xml: bytes) -> Element:
    if len(xml) > _LARGEST:
        raise CameraProtocol(f"the camera's description has {len(xml)} bytes")
    builder = _Builder()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = builder.refuse
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.characters
    try:
        parser.Parse(xml, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise CameraProtocol(f"the camera's description is no XML ({error})") from error
    return builder.finished[0]


class _Builder:
    """Puts elements together from expat's calls."""

    def __init__(self) -> None:
        self.finished: list[Element] = []
        self._open: list[tuple[str, dict[str, str], list[str], list[Element]]] = []

    def refuse(self, *place: object) -> None:
        raise CameraProtocol("the camera's description has a document type, which could hide entities")

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        if len(self._open) >= _DEEPEST:
            raise CameraProtocol("the camera's description is nested too deeply")
        self._open.append((tag.rpartition(":")[2], attributes, [], []))

    def characters(self, text: str) -> None:
        self._open[-1][2].append(text)

    def end(self, tag: str) -> None:
        name, attributes, text, children = self._open.pop()
        element = Element(name, attributes, "".join(text).strip(), tuple(children))
        (self._open[-1][3] if self._open else self.finished).append(element)
