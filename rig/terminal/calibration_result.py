"""Results of `rig calibrate`, as its terminal and `--json` say them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from calib import place_views
from calib.data import learned
from calib.request import LightPart
from imaging.session import calibration as calibrations
from imaging.session import coordinates, view_id
from imaging.session import session as sessions
from rig.terminal.result import CommandResult
from rig.terminal.text import command_line, counted, number

LIGHT: dict[str, tuple[LightPart, str]] = {
    "exposure_each_photograph": ("exposure", "exposure of each photograph"),
    "white_balance_each_photograph": ("white_balance", "white balance of each photograph"),
    "vignetting": ("falloff", "falloff"),
    "vignetting_each_camera": ("falloff", "falloff of each camera"),
    "camera_gain": ("gain", "sensitivity of each camera"),
    "white_balance": ("white_balance", "white balance between cameras"),
}
"""Part and display name of each rung of light."""


def cameras_result(session: Path, record: "calibrations.CalibrationRecord") -> CommandResult:
    """Result of a calibration of cameras without poses."""
    report = session / "calibration" / "report.html"
    evidence = {camera.name: camera.response.evidence for camera in record.cameras}
    responses = {camera.name: camera.response.kind for camera in record.cameras}
    lines = [f"{session}: {name}: {responses[name]}, {why}" for name, why in evidence.items()]
    for camera in record.cameras:
        for sensor in camera.sensors:
            words = [
                f"{what} {number(value.value)} ± {number(value.sigma)} {unit}".rstrip()
                for what, value, unit in (
                    ("gain", sensor.gain, "DN/e⁻"),
                    ("read noise", sensor.read_noise, "e⁻"),
                    ("ceiling", sensor.ceiling, "DN"),
                )
                if value is not None
            ]
            at = "" if sensor.iso is None else f" at ISO {sensor.iso:g}"
            figures = ", ".join(words) or "gain, read noise and ceiling are not determined"
            lines.append(f"{session}: {camera.name}{at}: {figures}")
    sensors = {
        camera.name: [
            sensor.model_dump(mode="json", exclude={"defects", "transfer"}) for sensor in camera.sensors
        ]
        for camera in record.cameras
    }
    data = {
        "session": str(session),
        "responses": responses,
        "luminance": _luminance_figures(record),
        "sensors": sensors,
        "charts": _chart_figures(record),
        "report": str(report),
    }
    lines += [f"{session}: {doubt}" for doubt in record.doubts]
    lines += [*_chart_lines(session, record), *_luminance_lines(session, record)]
    lines.append(f"Report: {report}")
    opened = sessions.Session.open(session)
    raw_or_photographs = any(camera.kind != "hdr" for camera in opened.record.cameras)
    if opened.lamps() is not None and raw_or_photographs:  # the noise of linear EXR is not known
        lines.append(f"Next: {command_line('rig', 'normals', session, 'normals.exr')}")
    return CommandResult(data, lines)


def _chart_lines(session: Path, record: "calibrations.CalibrationRecord") -> list[str]:
    """A line for each camera that saw a chart: how well its colours fit."""
    return [
        f"{session}: {name}: colours by the chart at frame {chart['frame']}, delta E 2000 of held-out "
        f"patches {number(chart['delta_e_mean'])} in the mean, {number(chart['delta_e_max'])} at most"
        for name, chart in _chart_figures(record).items()
    ]


def _luminance_lines(session: Path, record: "calibrations.CalibrationRecord") -> Iterator[str]:
    """The scale of light and its readings; why one of an earlier run is lost."""
    scale = record.luminance
    if scale is None:
        for rung in record.rungs:
            if rung.name == "luminance":
                yield f"{session}: the light has no scale in cd/m2 any more: {rung.reason}"
        return
    yield f"{session}: light of 1 is {scale}, for {', '.join(scale.cameras)}"
    if len(scale.readings) > 1:
        for one in scale.readings:
            percent = f"{100 * one.residual:+.2g}".replace("-", "−")
            yield f"{session}: {one.reading}: {number(one.luminance)} cd/m², {percent} % off that scale"


def _light_lines(session: Path, record: "calibrations.CalibrationRecord") -> Iterator[str]:
    """A line for each part of light that was taken, or that scene points ask for against the files, with its
    size and how to do without it.
    """
    asked = set()
    for view in record.views:
        asked |= {"exposure_each_photograph"} if view.exposure_asked else set()
        asked |= {"white_balance_each_photograph"} if view.white_balance_asked else set()
    for rung in record.rungs:
        if (rung.taken or rung.name in asked) and rung.name in LIGHT:
            part, name = LIGHT[rung.name]
            yield f"{session}: {name}: {rung.reason} (--without {part} leaves it out)"


def _coordinate_lines(session: Path, record: "calibrations.CalibrationRecord") -> Iterator[str]:
    """Coordinates of the scene, their error, and each surveyed point."""
    where = record.coordinates
    for rung in record.rungs:
        if rung.name in ("survey", "gps", "onto"):
            yield f"{session}: {rung.name}: {rung.reason}"
    if where is None:
        return
    metric = record.unit == "m"
    place = coordinates.length_text(where.position_error) if metric else number(where.position_error, 2)
    scale = "" if where.scale_error is None else f"scale to {number(100 * where.scale_error, 2)} %, "
    yield (
        f"{session}: coordinates are {where.described}{where.less_offset}, "
        f"{'in metres' if metric else 'without a unit'}: {scale}"
        f"turn to {number(where.rotation_error, 2)}°, place to {place} (standard errors)"
    )
    for point in where.points:
        yield f"{session}: {point}"


def _luminance_figures(record: "calibrations.CalibrationRecord") -> dict[str, Any] | None:
    """Scale of light; None if it is relative."""
    return None if record.luminance is None else record.luminance.model_dump(mode="json")


def _chart_figures(record: "calibrations.CalibrationRecord") -> dict[str, dict[str, Any]]:
    """The figures of each camera's chart, by its name."""
    fields = {"frame", "delta_e_mean", "delta_e_p95", "delta_e_max", "delta_e_files"}
    return {
        camera.name: camera.chart.model_dump(mode="json", include=fields)
        for camera in record.cameras
        if camera.chart is not None
    }


def _left_out(session: Path, record: "calibrations.CalibrationRecord") -> Iterator[str]:
    """The images without a pose, by cause, with what to do about it."""
    names = sessions.Session.open(session).photograph_names()
    alone = [names.get(view, str(view)) for view in record.unregistered if view not in record.contradicted]
    given = any(rung.name == "poses" and rung.reason.startswith("given by ") for rung in record.rungs)
    if alone and given:  # nothing was looked for in the pictures
        yield f"{', '.join(alone)} came without: rig calibrate without --only looks for the poses of all"
    elif alone:
        yield (
            f"too little of {', '.join(alone)} was recognised in the others: leave out what is blurred, or "
            "take more pictures between these and their neighbours"
        )

        if (
            len(record.views) < place_views.FEW * (len(record.views) + len(record.unregistered))
            and not learned.available()
        ):
            yield f"learned features find more, minutes later: {learned.INSTALL}, then calibrate again"
    contradicted = [names.get(view, str(view)) for view in record.unregistered if view in record.contradicted]
    if contradicted:
        yield (
            f"{', '.join(contradicted)} would have poses that other views contradict, as happens where "
            "parts of a scene look alike: take more pictures around them, put something unique beside "
            "them, or keep them with --keep-doubtful"
        )


def _why_unplaced(record: "calibrations.CalibrationRecord", view: "view_id.ViewId") -> str:
    """Reason why an image got no pose from its own contents."""
    if view in record.contradicted:
        return "contradicts other images about where it stands"
    return "shows nothing that was recognised"


def _next(session: Path, record: "calibrations.CalibrationRecord") -> str:
    if record.turned:
        return command_line("rig", "merge", session, "--panorama", session / "panorama.exr")
    return command_line("rig", "reconstruct", session)


def poses_result(session: Path, record: "calibrations.CalibrationRecord") -> CommandResult:
    """Result of a calibration with poses."""
    report = session / "calibration" / "report.html"
    images = len(record.views) + len(record.unregistered)
    by_rig = [view.id for view in record.views if view.by_rig]
    lines = [
        f"{session}: {len(record.views)} of {counted(images, 'image')} with a pose, "
        f"{counted(record.points, 'scene point')}, reprojection error {number(record.reprojection_px)} px",
        *[f"{session}: {view} {_why_unplaced(record, view)}: its pose is the rig's" for view in by_rig],
        *[f"{session}: {rung.reason}" for rung in record.rungs if rung.name == calibrations.MOTION],
        *[f"{session}: {rung.reason}" for rung in record.rungs if rung.name in place_views.FURTHER.values()],
        *[f"{session}: {doubt}" for doubt in record.doubts],
        *_light_lines(session, record),
        *_coordinate_lines(session, record),
        *_chart_lines(session, record),
        *_luminance_lines(session, record),
        f"Report: {report}",
        f"Next: {_next(session, record)}",
    ]
    data = {
        "session": str(session),
        "registered": len(record.views),
        "images": images,
        "unregistered": [str(view) for view in record.unregistered],
        "contradicted": [str(view) for view in record.contradicted],
        "by_rig": [str(view) for view in by_rig],
        "doubts": list(record.doubts),
        "points": record.points,
        "reprojection_px": record.reprojection_px,
        "luminance": _luminance_figures(record),
        "charts": _chart_figures(record),
        "unit": record.unit,
        "coordinates": None if record.coordinates is None else record.coordinates.model_dump(mode="json"),
        "report": str(report),
    }
    missing = None
    if record.unregistered:
        missing = (
            f"{session}: {counted(len(record.unregistered), 'image')} of {images} got no pose: "
            + "; ".join(_left_out(session, record))
        )
    return CommandResult(data, lines, missing, usable=bool(record.views))
