"""One operation of a PTP responder: what it is asked, what it replies, and which way its data go."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from drivers.ptp.protocol.codes import (
    CanonOperation,
    NikonOperation,
    Operation,
    ResponseCode,
    SonyOperation,
)
from drivers.sim.faults import Fault
from drivers.sim.ptp.profiles import Style


class Phase(Enum):
    """Direction of the data of an operation."""

    NONE = "none"
    TO_HOST = "to host"
    TO_CAMERA = "to camera"


@dataclass(frozen=True)
class Request:
    """An operation with all that came for it. faults: what goes wrong with it."""

    operation: int
    transaction: int
    parameters: tuple[int, ...] = ()
    data: bytes = b""
    faults: tuple[Fault, ...] = ()

    def parameter(self, index: int) -> int:
        """A parameter, 0 if it was left out."""
        return self.parameters[index] if index < len(self.parameters) else 0


@dataclass(frozen=True)
class Reply:
    """Response, and the data before it; `data` is None without a data phase."""

    code: int = ResponseCode.OK
    parameters: tuple[int, ...] = ()
    data: bytes | None = None


@dataclass(frozen=True)
class Handler:
    """Implementation of an operation in a responder, and whether it releases the shutter with these
    parameters.
    """

    act: Callable[[Request], Reply]
    phase: Phase = Phase.NONE
    shoots: Callable[[Request], bool] = lambda request: False


_MAKERS = {Style.CANON: CanonOperation, Style.NIKON: NikonOperation, Style.SONY: SonyOperation}


def operation_name(code: int, style: Style) -> str:
    """The name by which fault scripts call an operation: that of its enumeration, or its number."""
    for operations in (Operation, _MAKERS.get(style)):
        if operations is not None and code in operations.__members__.values():
            return operations(code).name
    return f"0x{code:04X}"
