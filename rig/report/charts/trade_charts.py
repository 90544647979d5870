"""Trade-offs drawn: quality over what it costs, the front, and where the presets lie."""

from collections.abc import Callable, Iterable, Sequence

from recon.trade import Point, Trade, front
from rig.report.charts.chart import AxisStyle, Series, chart
from rig.report.charts.topic import Figure
from rig.report.metric_words import BY_KEY

Value = Callable[[Point], float]

PRESETS = {"draft": 1, "standard": 2, "best": 3}
"""The colour of each preset's dot; those of all other trainings share one."""


def comparable(trade: Trade) -> bool:
    """Return whether each training had a machine to itself, and all the same kind of it."""
    return all(point.at_once == 1 for point in trade.points) and len({p.device for p in trade.points}) < 2


def costs(trade: Trade) -> list[tuple[str, str, Value]]:
    """Return what a point may cost: heading, axis and value."""
    time: tuple[str, str, Value] = (
        ("time", "training time, s", lambda point: point.seconds)
        if comparable(trade)
        else ("processor time", "processor time of all threads, s", lambda point: point.processor_seconds)
    )
    return [
        time,
        ("Gaussians", "Gaussians", lambda point: float(point.gaussians)),
        ("size", "size of splats.ply, MB", lambda point: point.size_bytes / 1e6),
    ]


def figures(trade: Trade) -> Iterable[Figure]:
    """Quality over each cost, as the method sees it, and against the truth where that is known."""
    yield from _over(trade, trade.points, BY_KEY[trade.measure].on_axis, "Quality", lambda point: point.db)
    measured = [point for point in trade.points if point.truth_db is not None]
    axis = "µ-law PSNR to the true light, dB"
    yield from _over(trade, measured, axis, "Truth", lambda point: point.truth_db or 0.0)


def _over(trade: Trade, points: Sequence[Point], axis: str, heading: str, value: Value) -> Iterable[Figure]:
    if len(points) < 2:
        # A dot alone is no curve: the table says all there is.
        return
    for name, label, cost in costs(trade):
        best = front(points, cost, value)
        named = [
            Series(
                preset, [cost(p) for p in trainings], [value(p) for p in trainings], dots=True, colour=colour
            )
            for preset, colour in PRESETS.items()
            if (trainings := [p for p in points if is_preset(p, preset)])
        ]
        others = [p for p in points if not any(is_preset(p, preset) for preset in PRESETS)]
        series = [
            Series(
                "front: nothing is better for less",
                [cost(p) for p in best],
                [value(p) for p in best],
                colour=4,
            ),
            Series("a training", [cost(p) for p in others], [value(p) for p in others], dots=True, colour=0),
            *named,
        ]
        yield Figure(
            f"{heading} against {name}",
            f"Each dot is a training; higher and further left is better. {_count(best)} on the front.",
            chart(f"{heading} against {name}", series, AxisStyle(label, "log"), axis),
        )


def is_preset(point: Point, name: str) -> bool:
    """Return whether it is a preset as it is."""
    return point.choice.quality == name and not point.choice.overrides.words()


def _count(points: Sequence[Point]) -> str:
    return "One lies" if len(points) == 1 else f"{len(points)} lie"
