"""Known lamps of a light dome: `lamps.json`."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from imaging.record import Record

Frame = Annotated[int, Field(ge=0)]


class LampsRecord(Record):
    """`lamps.json` of a session whose camera and things stand still while one lamp after another is lit.

    Axes are those of normal maps: x right and y up in the picture, z towards the camera.
    """

    schema_version: Literal[1] = 1
    reason: str
    """Origin of the places."""
    places: dict[Frame, tuple[float, float, float] | None]
    """Place of the lamp that is lit at each frame, m from the middle of what the picture shows; of far lamps
    any length, since only the direction counts. None: no lamp is lit, and the light is that of the room."""
    brightness: dict[Frame, Annotated[float, Field(gt=0)]] = Field(default_factory=dict)
    """Relative intensity of the lamp at a frame; 1 where none is stated."""
    across: float | None = Field(default=None, gt=0)
    """Width of what the picture shows at the things, m; None: the lamps are far, and light all alike."""
    spread: float = Field(gt=0, le=1)
    """Relative standard error of the light of a lamp on the things."""
    camera: str | None = None
    """Camera that the axes are of; None: the only one."""

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if any(place == (0, 0, 0) for place in self.places.values()):
            raise ValueError("a lamp stands at 0, 0, 0, amidst the things")
        return self
