"""Response codes by which a camera refuses an operation, as errors."""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.errors import CameraRefused
from drivers.ptp.protocol.codes import ResponseCode


class RefusedWith(CameraRefused):
    """The camera refused with a response code, `code`."""

    def __init__(self, where: str, operation: int, code: int) -> None:
        is_standard = code in ResponseCode.__members__.values()
        reason = ResponseCode(code).name.lower().replace("_", " ") if is_standard else f"code 0x{code:04X}"
        fix = "free its card" if code == ResponseCode.STORE_FULL else "check its mode dial and menus"
        super().__init__(f"{where} refused operation 0x{operation:04X} ({reason}): {fix}.")
        self.code = code


@contextmanager
def passing_over(code: int) -> Iterator[None]:
    """Let a refusal with this code end the block without an error."""
    try:
        yield
    except RefusedWith as error:
        if error.code != code:
            raise
