"""The forecast of a shoot, and what it came to, in words and as numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from rig.terminal.text import counted, duration, size

if TYPE_CHECKING:
    from capture.record.forecast import Forecast
    from imaging.session.records import PlanRecord, RunRecord


def forecast_line(forecast: Forecast, pause: float | Literal["key"] = 0.0) -> str:
    """One sentence: seconds and bytes in all and at each position, and the room on the disk."""
    frames = max(1, forecast.frames)
    about = duration(forecast.seconds)
    if forecast.on_one_bus > 1.1 * forecast.seconds:
        about += f" (up to {duration(forecast.on_one_bus)} on one bus)"
    each = f"{duration(forecast.seconds / frames)}"
    room = f"{size(forecast.free)} are free"
    if forecast.size is None:
        about += ", and bytes that no camera states before its first picture"
    else:
        about += f" and {size(forecast.size)}"
        each += f" and {size(forecast.size / frames)}"
        if not forecast.fits:
            enough = counted(forecast.free * forecast.shots // forecast.size, "shot")
            room = (
                f"only {size(forecast.free)} are free, so it stops after about {enough} unless you free "
                "space; --resume then goes on"
            )
    more = ""
    if pause == "key":
        more = ", beside the time in which you move things"
    elif pause and frames > 1:
        more = f", beside {counted(frames - 1, 'pause')} of {pause:g} s"
    each = f"; {each} at each of {forecast.frames} frames" if forecast.frames > 1 else ""
    return f"Forecast for {counted(forecast.shots, 'shot')} ({forecast.basis}): {about}{more}{each}; {room}."


def view_lines(forecast: Forecast, plan: PlanRecord) -> list[str]:
    """Exposures and bytes of a view of each camera; cameras with the same share a line."""
    names: dict[int | None, list[str]] = {}
    for name, count in forecast.sizes.items():
        names.setdefault(count, []).append(name)
    exposures = counted(len(plan.bracket), "exposure")
    return [
        f"  {', '.join(group)}: {exposures} of {size(count)}, {size(count * len(plan.bracket))} a view"
        for count, group in names.items()
        if count is not None
    ]


def forecast_data(forecast: Forecast, plan: PlanRecord) -> dict[str, Any]:
    """The same as numbers."""
    return {
        "seconds": forecast.seconds,
        "seconds_on_one_bus": forecast.on_one_bus,
        "seconds_per_frame": forecast.seconds / max(1, forecast.frames),
        "bytes": forecast.size,
        "bytes_per_view": {
            name: None if count is None else count * len(plan.bracket)
            for name, count in forecast.sizes.items()
        },
        "basis": forecast.basis,
        "free_bytes": forecast.free,
        "fits": forecast.fits,
    }


def outcome_line(run: RunRecord) -> str:
    """State seconds and bytes of a run beside its forecast."""
    forecast = "unknown" if run.forecast_bytes is None else size(run.forecast_bytes)
    return (
        f"{counted(run.shots, 'shot')} took {duration(run.seconds)} (forecast "
        f"{duration(run.forecast_seconds)}) and {size(run.bytes)} (forecast {forecast})."
    )
