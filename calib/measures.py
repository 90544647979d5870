"""Measurements of a calibration, by the part that is asked for, and which options go with which part."""

from dataclasses import dataclass
from typing import Literal, get_args

from calib.colour import unfiltered
from calib.colour.colour_record import CHART_RUNGS
from calib.light.radiometry import LIGHT_RUNGS
from calib.request import CalibrationRequest, LightPart, Part
from calib.sensor.rungs import NAMES
from imaging.errors import InputError
from imaging.request import value_of
from imaging.session.calibration import COLOUR


@dataclass(frozen=True)
class Measures:
    """Measurements of a run; all other fields and rungs of an earlier calibration are kept.

    scene: whether it needs shots of a scene though there are shots of a board; chart: whether a colour chart
    may be searched for; fields: of each camera.
    """

    sensors: bool = False
    light: bool = False
    chart: bool = False
    poses: bool = False
    scene: Literal["always", "without a board", "never"] = "always"
    fields: tuple[str, ...] = ()
    rungs: frozenset[str] = frozenset()


MEASURES: dict[Part | None, Measures] = {
    None: Measures(sensors=True, light=True, chart=True, poses=True, scene="without a board"),
    "sensor": Measures(sensors=True, scene="never", fields=("noise", "sensors"), rungs=NAMES),
    "response": Measures(light=True, fields=("response",), rungs=LIGHT_RUNGS),
    "colour": Measures(
        light=True,
        chart=True,
        fields=("camera_from_rec709", "chart"),
        rungs=frozenset({COLOUR, unfiltered.NAME, *CHART_RUNGS}),
    ),
    "luminance": Measures(),
    "poses": Measures(sensors=True, poses=True, scene="without a board"),
}
"""Measurements by part; those under None are of a whole calibration."""


def require_usable(request: CalibrationRequest) -> None:
    """Raise InputError for options that do not go with each other or with the part."""
    only, without, measures = request.only, request.without or (), MEASURES[request.only]
    if request.chart and not measures.chart:
        raise InputError(f"a chart measures colour, not the {only}: leave --chart or --only {only} out.")
    if not measures.poses and (request.survey is not None or request.onto is not None):
        raise InputError(f"--survey and --onto place poses, not the {only}: leave them or --only {only} out.")
    if not measures.poses and without:
        raise InputError(
            f"--without leaves out what scene points show, not the {only}: leave it or --only {only} out."
        )
    if unknown := set(without) - set(get_args(LightPart)):
        parts = ", ".join(get_args(LightPart))
        raise InputError(f"there is no part {sorted(unknown)[0]!r} to leave out: choose from {parts}.")
    if value_of(request.survey) is not None and value_of(request.onto) is not None:
        raise InputError("A session has one system of coordinates: give --survey or --onto, not both.")
    if value_of(request.survey) is None and (request.marks is not None or request.markers is not None):
        raise InputError("Marks and markers are of surveyed points: give --survey FILE with them.")
    if request.keep_doubtful and not measures.poses:
        raise InputError(f"--keep-doubtful is about poses, not the {only}: leave it or --only {only} out.")
