"""Elements of a GenICam description, children in the order that the GenApi schema 1.1 wants."""

from collections.abc import Iterable, Mapping

from drivers.genicam.chunks import ByteOrder


def category(name: str, features: Iterable[str]) -> str:
    """A Category of features."""
    inside = "".join(f"<pFeature>{feature}</pFeature>" for feature in features)
    return f'<Category Name="{name}">{inside}</Category>'


def register(
    kind: str,
    name: str,
    address: int,
    *,
    length: int = 4,
    access: str = "RW",
    port: str = "Device",
    index: tuple[str, int] | None = None,
) -> str:
    """A register; `index` is the node that chooses among several, and the bytes from one to the next."""
    chosen = "" if index is None else f'<pIndex Offset="{index[1]}">{index[0]}</pIndex>'
    sign = "<Sign>Unsigned</Sign>" if kind == "IntReg" else ""
    order = "" if kind == "StringReg" else "<Endianess>LittleEndian</Endianess>"
    return (
        f'<{kind} Name="{name}"><Address>{address:#x}</Address>{chosen}<Length>{length}</Length>'
        f"<AccessMode>{access}</AccessMode><pPort>{port}</pPort><Cachable>NoCache</Cachable>"
        f"{sign}{order}</{kind}>"
    )


def text(name: str, address: int, length: int) -> str:
    """A string that cannot be set."""
    return register("StringReg", name, address, length=length, access="RO")


def integer(
    name: str,
    address: int,
    low: int,
    high: int | str,
    *,
    step: int | None = None,
    available: str | None = None,
    access: str = "RW",
) -> str:
    """An Integer over a register; `high` may be a node."""
    most = f"<pMax>{high}</pMax>" if isinstance(high, str) else f"<Max>{high}</Max>"
    steps = "" if step is None else f"<Inc>{step}</Inc>"
    there = "" if available is None else f"<pIsAvailable>{available}</pIsAvailable>"
    return (
        f'<Integer Name="{name}">{there}<pValue>{name}Reg</pValue><Min>{low}</Min>{most}{steps}</Integer>'
        + register("IntReg", f"{name}Reg", address, access=access)
    )


def knife(name: str, variables: Mapping[str, str], formula: str) -> str:
    """A whole number by a formula over the nodes that `variables` name."""
    given = "".join(f'<pVariable Name="{key}">{node}</pVariable>' for key, node in variables.items())
    safe = formula.replace("&", "&amp;").replace(">", "&gt;")
    return f'<IntSwissKnife Name="{name}">{given}<Formula>{safe}</Formula></IntSwissKnife>'


def enumeration(
    name: str, address: int | None, entries: Mapping[str, int], *, locked: str | None = None
) -> str:
    """An Enumeration over a register of its own, or over one that is described elsewhere.

    locked: a node that is not 0 while it cannot be set.
    """
    inside = "".join(
        f'<EnumEntry Name="{entry}"><Value>{value}</Value></EnumEntry>' for entry, value in entries.items()
    )
    lock = "" if locked is None else f"<pIsLocked>{locked}</pIsLocked>"
    register_xml = "" if address is None else register("IntReg", f"{name}Reg", address)
    return f'<Enumeration Name="{name}">{lock}{inside}<pValue>{name}Reg</pValue></Enumeration>{register_xml}'


def boolean(name: str, address: int) -> str:
    """A Boolean over a register of its own."""
    return (
        f'<Boolean Name="{name}"><pValue>{name}Reg</pValue><OnValue>1</OnValue><OffValue>0</OffValue>'
        "</Boolean>" + register("IntReg", f"{name}Reg", address)
    )


def command(name: str, address: int, value: int = 1) -> str:
    """A Command that writes a value to a register of its own."""
    return (
        f'<Command Name="{name}"><pValue>{name}Reg</pValue><CommandValue>{value}</CommandValue></Command>'
        + register("IntReg", f"{name}Reg", address)
    )


def selected(
    comment: str, address: int, selector: str, entries: Mapping[str, tuple[int, int]], order: ByteOrder
) -> str:
    """A register for each value of a selector, cut into `entries`: lowest and highest bit by name.

    In registers that are big endian the description counts bits from the highest.
    """
    first = 31 if order == "big" else 0
    inside = "".join(
        f'<StructEntry Name="{name}"><LSB>{abs(first - ends[0])}</LSB><MSB>{abs(first - ends[1])}</MSB>'
        "</StructEntry>"
        for name, ends in entries.items()
    )
    return (
        f'<StructReg Comment="{comment}"><Address>{address:#x}</Address>'
        f'<pIndex Offset="4">{selector}</pIndex><Length>4</Length><AccessMode>RW</AccessMode>'
        "<pPort>Device</pPort><Cachable>NoCache</Cachable><Endianess>LittleEndian</Endianess>"
        f"{inside}</StructReg>"
    )
