"""Stated angles of a turntable: `turntable.json`."""

from typing import Annotated, Literal

from pydantic import Field

from imaging.record import Record


class TurntableRecord(Record):
    """`turntable.json` of a session whose cameras stand still while what they see turns on one axis."""

    schema_version: Literal[1] = 1
    reason: str
    """Origin of the angles."""
    degrees: dict[Annotated[int, Field(ge=0)], Annotated[float, Field(ge=-36_000, le=36_000)]]
    """Angle of the table at each frame, all in one direction."""
    spread: float = Field(gt=0, le=90)
    """Standard error of an angle, degrees."""
