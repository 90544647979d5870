"""Options that place a scene in coordinates."""

from dataclasses import dataclass
from pathlib import Path

SURVEY_HELP = (
    "Surveyed points: a table with name,x,y,z in metres (or easting,northing,height, or "
    "latitude,longitude,altitude) and sigma; they stay for later runs, none forgets them."
)


@dataclass(frozen=True)
class Anchors:
    """Surveyed points, where images show them, and the markers that stand on them; or another session."""

    survey: Path | None = None
    marks: Path | None = None
    markers: str | None = None
    onto: Path | None = None


NO_ANCHORS = Anchors()
