"""`rig capture --dry-run`: what would be shot, and what each exposure is worth, as a table and as numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from capture.bracket import automatic
from capture.record import shooting
from capture.request import RigRequest
from capture.rigfile import rigfile
from rig.cameras import focusing, forecast_in_words
from rig.cameras.usb_bus import source_of
from rig.terminal import tables
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult
from rig.terminal.text import counted

if TYPE_CHECKING:
    from capture.bracket.planner import Target
    from imaging.optics.exposure import Exposure

_FRAMES = {"scene": "position", "dark": "repeat", "flat": "repeat", "board": "pose"}


def rehearse(
    sim: str | None,
    out: Path,
    status: StatusLine,
    request: RigRequest,
    *,
    rig: rigfile.RigFile | None,
    seed: int,
) -> CommandResult:
    """Plan what would be shot and say so; nothing is written."""
    with source_of(sim, seed, rig, request, status) as source:
        done = shooting.rehearse(source, out, request, progress=status, say=status.say)
        able = {name: camera.capabilities() for name, camera in source.cameras.items()}
    record = done.record
    focus = {} if rig is None else focusing.focus_plans(rig.tables, able, record.bracket[0])
    steps = [str(exposure) for exposure in record.bracket]
    shots = len(record.cameras) * len(record.frames) * len(steps)
    width, height = done.size or (None, None)
    big = f" of {width} x {height}" if width and height else ""
    data = {
        "session": str(out),
        "kind": record.kind,
        "cameras": list(record.cameras),
        "frames": len(record.frames),
        "bracket": steps,
        "reason": record.reason,
        "shots": shots,
        "pending": done.forecast.shots,
        "width": width,
        "height": height,
        "forecast": forecast_in_words.forecast_data(done.forecast, record),
        "focus": focusing.focus_data(focus),
    }
    lines = [
        f"{counted(len(record.cameras), 'camera')}, {counted(len(record.frames), _FRAMES[record.kind])}, "
        f"{counted(len(steps), 'exposure')} each ({', '.join(steps)}): {counted(shots, 'shot')}{big}, "
        f"into {out}"
    ]
    if request.resume:
        lines.append(f"{done.forecast.shots} of {counted(shots, 'shot')} still to take")
    pause = 0.0 if rig is None or sim is not None else rig.tables.pause
    lines += [
        forecast_in_words.forecast_line(done.forecast, pause),
        *forecast_in_words.view_lines(done.forecast, record),
    ]
    if record.kind != "scene":
        return CommandResult(data, lines)
    lines += focusing.focus_lines(focus, rig is not None)
    more, table = _worth(done)
    return CommandResult(data | more, lines + table)


def _worth(done: shooting.Rehearsal) -> tuple[dict[str, Any], list[str]]:
    """The metered range, the worth of every exposure by camera and for the rig, and what is missed."""
    if done.metering is None:
        return {"metered": None, "unmetered": done.unmetered}, [f"Not metered: {done.unmetered}"]
    targets = done.metering.targets
    exposures = [exposure for exposure in done.record.bracket if exposure is not None]
    table = [automatic.worths(targets, exposure) for exposure in exposures]
    lines = _table(exposures, table)
    lines.append(
        "SNR at the darkest 0.1 % of what a camera sees, headroom in stops above its brightest 0.01 %; "
        f"{_range(targets)}."
    )
    missed = [] if done.plan is None else [str(shortfall) for shortfall in done.plan.shortfalls]
    missed += [f"{name} was not metered: {why}" for name, why in done.metering.failed.items()]
    lines += [f"  {sentence}" for sentence in missed]
    data = {
        "metered": {
            "probes": [str(probe) for probe in done.metering.probes],
            "failed": dict(done.metering.failed),
            "ranges": [
                {
                    "camera": target.camera,
                    "channel": target.channel,
                    "dark": target.dark,
                    "bright": target.bright,
                    "stops": target.stops,
                    "dark_end_found": target.no_darker,
                    "bright_end_found": target.no_brighter,
                }
                for target in targets
            ],
        },
        "exposures": [
            {
                "exposure": exposure.model_dump(mode="json"),
                "worth": {
                    name: {"snr_db": _finite(worth.snr), "headroom_stops": worth.headroom}
                    for name, worth in row.items()
                },
            }
            for exposure, row in zip(exposures, table, strict=True)
        ],
        "not_reached": missed,
    }
    return data, lines


def _table(exposures: Sequence[Exposure], worths: Sequence[Mapping[str, automatic.Worth]]) -> list[str]:
    """The rig and its cameras side by side, or where they are too many the worst camera for each end."""
    names = [name for name in worths[0] if name != "rig"]
    first = max(len("exposure"), *(len(str(exposure)) for exposure in exposures))
    wide = [max(14, len(name)) for name in ("rig", *names)]
    if first + sum(wide) + 2 * len(wide) <= tables.columns_of_text():
        lines = [" " * first + "".join(f"  {n:>{w}}" for n, w in zip(("rig", *names), wide, strict=True))]
        lines.append(f"{'exposure':{first}}" + "".join(f"  {'SNR dB headroom':>{w}}" for w in wide))
        for exposure, row in zip(exposures, worths, strict=True):
            cells = [f"{_snr(row[name]):>6} {_headroom(row[name]):>7}" for name in ("rig", *names)]
            lines.append(
                f"{exposure!s:{first}}" + "".join(f"  {c:>{w}}" for c, w in zip(cells, wide, strict=True))
            )
        return lines
    long = max(len("worst"), *map(len, names))
    lines = [f"{'exposure':{first}}  SNR dB  {'worst':{long}}  headroom  worst"]
    for exposure, row in zip(exposures, worths, strict=True):
        darkest = min(names, key=lambda name: row[name].snr)
        brightest = min(names, key=lambda name: row[name].headroom)
        lines.append(
            f"{exposure!s:{first}}  {_snr(row['rig']):>6}  {darkest:{long}}  "
            f"{_headroom(row['rig']):>8}  {brightest}"
        )
    return lines


def _snr(worth: automatic.Worth) -> str:
    return f"{'' if worth.snr_known else '<'}{worth.snr:.1f}"


def _headroom(worth: automatic.Worth) -> str:
    return f"{'' if worth.headroom_known else '<'}{worth.headroom:+.1f}"


def _range(targets: Sequence[Target]) -> str:
    """Stops of the widest range, of one that lacks an end the least that it may have; what < then means."""
    widest = max(targets, key=lambda target: (target.stops, not _is_whole(target)))
    most = "" if all(map(_is_whole, targets)) else "at least " if _is_whole(widest) else "more than "
    bound = "; < is the most that it may be, where the meter found no end" if most else ""
    return f"{most}{widest.stops:.1f} stops lie between them ({widest}){bound}"


def _is_whole(target: Target) -> bool:
    """Return whether the meter found both ends."""
    return target.no_darker and target.no_brighter


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return value if math.isfinite(value) else None
