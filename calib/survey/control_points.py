"""Control of a session's coordinates: surveyed points with their marks, and another session."""

from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

from calib.survey.marks import Marks, dictionary_of, numbers_of, read_marks
from calib.survey.points import Survey, SurveyPosition, read_survey
from imaging.errors import InputError
from imaging.session.coordinates import CoordinateSystem
from imaging.session.session import Session


@dataclass(frozen=True)
class Control:
    """A survey, what was marked of it, px of the files, and the dictionary of its markers, if it has any."""

    survey: Survey
    marks: Marks = field(default_factory=dict)
    dictionary: str | None = None


def read_control(
    session: Session,
    survey: str | PathLike[str],
    marks: str | PathLike[str] | None,
    markers: str | None,
) -> Control:
    """Read the control from these files.

    Args:
        session: Session whose views the marks name.
        survey: File with surveyed points.
        marks: File with places in images that were clicked; None without.
        markers: Name of the dictionary of printed markers; None without.

    Returns:
        The control.

    Raises:
        InputError: A file is unusable, the dictionary is unknown or fits no point, or there are neither marks
            nor markers.
    """
    points = read_survey(Path(survey))
    if marks is None and markers is None:
        raise InputError(
            f"{survey} says where points are, and nothing which images show them: add --marks FILE with "
            "name, image, u and v, or --markers with the dictionary of printed markers."
        )
    clicked = {} if marks is None else read_marks(Path(marks), session, points.points)
    dictionary = None if markers is None else dictionary_of(markers)
    if dictionary is not None and not numbers_of(points.points):
        raise InputError(
            f"No point of {survey} is called by the number of a marker: name them 7 or marker 7, as printed."
        )
    return Control(points, clicked, dictionary)


def control_of(coordinates: CoordinateSystem) -> Control | None:
    """Return the control of an earlier calibration, from its record; None without a survey."""
    if not coordinates.points:
        return None
    points = {one.name: SurveyPosition(one.position, one.sigma) for one in coordinates.points}
    marks: Marks = {one.name: {mark.view: mark for mark in one.marks} for one in coordinates.points}
    return Control(Survey(points, coordinates.system, coordinates.origin), marks)
