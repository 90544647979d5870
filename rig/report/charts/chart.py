"""Line and dot charts as inline SVG, coloured by the page's style sheet so that they follow its scheme."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from markupsafe import Markup, escape

WIDTH, HEIGHT = 640, 300
LEFT, RIGHT, TOP, BOTTOM = 78, 18, 14, 48
COLOURS = 8
"""Series colours that the style sheet has: `s0` ... `s7`."""

MANY = 40
"""Dots of a series above which they are drawn smaller, so as not to hide each other."""

FEWEST_TICKS, MOST_TICKS = 3, 8
LEAST, MOST = 1e-300, 1e300
"""Range of values on a logarithmic axis."""

Scale = Literal["linear", "log"]


@dataclass(frozen=True)
class Series:
    """One curve or cloud: x and y of equal length; points that are not finite are left out."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    dots: bool = False
    dashed: bool = False
    colour: int | None = None
    """Index of a series colour; by order if None."""
    margin: Sequence[float] = ()
    """Half widths of a band around the line, as many as points; none if empty."""

    def reach(self) -> list[float]:
        """The ends in y of what is drawn."""
        if not len(self.margin):
            return list(self.y)
        pairs = list(zip(self.y, self.margin, strict=True))
        return [y - m for y, m in pairs] + [y + m for y, m in pairs]


@dataclass(frozen=True)
class AxisStyle:
    """Label and scale of an axis; zero: it begins at zero or before; whole: ticks are whole numbers."""

    label: str
    scale: Scale = "linear"
    zero: bool = False
    whole: bool = False


@dataclass(frozen=True)
class Axis:
    """One axis: what it shows, between which values, and its ticks."""

    label: str
    low: float
    high: float
    ticks: tuple[float, ...]
    scale: Scale = "linear"

    def place(self, value: float, start: float, end: float) -> float:
        """Return where a value lies between the pixels `start` and `end`."""
        low, high, at = (self._level(v) for v in (self.low, self.high, value))
        return start + (at - low) / (high - low) * (end - start)

    def _level(self, value: float) -> float:
        return math.log10(max(value, 1e-300)) if self.scale == "log" else value

    @classmethod
    def around(cls, style: AxisStyle, values: Sequence[float]) -> "Axis":
        """An axis that holds all finite `values`, with some air."""
        logarithmic = style.scale == "log"
        finite = [v for v in values if math.isfinite(v) and (v > 0 or not logarithmic)]
        low, high = (min(finite), max(finite)) if finite else (0.1 if logarithmic else 0.0, 1.0)
        if logarithmic:
            return cls._decades(style.label, low, high)
        if style.zero:
            low, high = min(low, 0.0), max(high, 0.0)
        if high - low < 1e-12 * max(abs(high), abs(low), 1e-12):
            pad = abs(high) * 0.5 or 0.5
            low, high = low - (0 if style.zero and low == 0 else pad), high + pad
        step = nice_step(max((high - low) / 5, 1.0 if style.whole else 0.0))
        low, high = math.floor(low / step + 1e-9) * step, math.ceil(high / step - 1e-9) * step
        count = round((high - low) / step)
        return cls(style.label, low, high, tuple(low + index * step for index in range(count + 1)))

    @classmethod
    def _decades(cls, label: str, low: float, high: float) -> "Axis":
        """Ticks from decade to decade; for a few decades, from 1, 2 or 5 of one to 1, 2 or 5 of another."""
        low, high = min(max(low, LEAST), MOST), min(max(high, LEAST), MOST)
        powers = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 2)
        steps = [factor * 10.0**power for power in powers for factor in (1, 2, 5)]
        below = max(step for step in steps if step <= low * (1 + 1e-9))
        above = min(step for step in steps if step >= max(high, 1.5 * below) * (1 - 1e-9))
        ticks = tuple(step for step in steps if below <= step <= above)
        if len(ticks) < FEWEST_TICKS:
            every = (factor * 10.0**power for power in powers for factor in range(1, 10))
            ticks = tuple(step for step in every if below <= step <= above)
        if len(ticks) <= MOST_TICKS:
            return cls(label, below, above, ticks, "log")
        first, last = math.floor(math.log10(low) + 1e-9), math.ceil(math.log10(high) - 1e-9)
        last = max(last, first + 1)
        step = max(1, math.ceil((last - first) / MOST_TICKS))
        return cls(
            label, 10.0**first, 10.0**last, tuple(10.0**e for e in range(first, last + 1, step)), "log"
        )


def nice_step(step: float) -> float:
    """The smallest of 1, 2, 5 times a power of ten that is at least `step`."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(power * factor for factor in (1, 2, 5, 10) if power * factor >= step * (1 - 1e-9))


def tick_text(value: float, axis: Axis) -> str:
    """A tick's label, as many decimals as the axis needs."""
    if axis.scale == "log":
        exponent = math.floor(math.log10(value) + 1e-9)
        if -3 <= exponent <= 6:
            return f"{value:,.{max(0, -exponent)}f}"
        return f"{value / 10.0**exponent:.0f}e{exponent}"
    step = axis.ticks[1] - axis.ticks[0] if len(axis.ticks) > 1 else 1.0
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    text = f"{value:,.{decimals}f}"
    return text.replace("-", "−") if float(text.replace(",", "")) else f"{0:.{decimals}f}"


def chart(
    title: str,
    series: Sequence[Series],
    x: str | AxisStyle,
    y: str | AxisStyle,
    *,
    shaded: tuple[float, float] | None = None,
    level: tuple[float, str] | None = None,
) -> Markup:
    """Draw series in one frame.

    Args:
        title: Heading for screen readers.
        series: Lines or dots, one colour each.
        x: Horizontal axis; of a label alone: linear, from where the values begin.
        y: Vertical axis, likewise.
        shaded: Range of x set off from the rest.
        level: Place and name of a horizontal line.

    Returns:
        An `<svg>` that scales with the page, and its legend.
    """
    extra = [level[0]] if level else []
    x_style, y_style = (AxisStyle(axis) if isinstance(axis, str) else axis for axis in (x, y))
    x_axis = Axis.around(x_style, [v for s in series for v in s.x])
    y_axis = Axis.around(y_style, [v for s in series for v in s.reach()] + extra)
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM

    def x_at(value: float) -> float:
        return x_axis.place(value, LEFT, right)

    def y_at(value: float) -> float:
        return y_axis.place(value, bottom, TOP)

    parts = [
        f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}">',
        f"<title>{escape(title)}</title>",
    ]
    if shaded:
        start, end = x_at(max(shaded[0], x_axis.low)), x_at(min(shaded[1], x_axis.high))
        parts.append(
            f'<rect class="shaded" x="{start:.1f}" y="{TOP}" width="{end - start:.1f}" '
            f'height="{bottom - TOP}"/>'
        )
    parts += _frame(x_axis, y_axis, right, bottom)
    if level:
        at = y_at(level[0])
        parts.append(f'<path class="level" d="M{LEFT} {at:.1f}H{right}"/>')
        parts.append(f'<text class="note" x="{right - 4}" y="{at - 5:.1f}">{escape(level[1])}</text>')

    def placed(x_values: Sequence[float], y_values: Sequence[float]) -> list[tuple[float, float]]:
        return [
            (x_at(x), y_at(y))
            for x, y in zip(x_values, y_values, strict=True)
            if math.isfinite(x)
            and math.isfinite(y)
            and (x_axis.scale == "linear" or x > 0)
            and (y_axis.scale == "linear" or y > 0)
        ]

    for index, line in enumerate(series):
        colour = (index if line.colour is None else line.colour) % COLOURS
        if len(line.margin):
            pairs = list(zip(line.y, line.margin, strict=True))
            # On a logarithmic axis a band that reaches below zero ends at the frame.
            least = y_axis.low if y_axis.scale == "log" else -math.inf
            low, high = [max(y - m, least) for y, m in pairs], [y + m for y, m in pairs]
            parts.append(_band(placed(line.x, low), placed(line.x, high), colour))
        points = placed(line.x, line.y)
        parts.append(_dots(points, colour) if line.dots else _line(points, colour, line.dashed))
    parts.append("</svg>")
    return Markup("".join(parts) + legend(series))


def _frame(x_axis: Axis, y_axis: Axis, right: float, bottom: float) -> list[str]:
    parts = []
    for tick in y_axis.ticks:
        at = y_axis.place(tick, bottom, TOP)
        parts.append(f'<path class="grid" d="M{LEFT} {at:.1f}H{right}"/>')
        parts.append(f'<text class="ytick" x="{LEFT - 8}" y="{at + 4:.1f}">{tick_text(tick, y_axis)}</text>')
    for tick in x_axis.ticks:
        at = x_axis.place(tick, LEFT, right)
        parts.append(f'<path class="grid" d="M{at:.1f} {TOP}V{bottom}"/>')
        parts.append(f'<text class="xtick" x="{at:.1f}" y="{bottom + 18}">{tick_text(tick, x_axis)}</text>')
    parts.append(
        f'<text class="xlabel" x="{(LEFT + right) / 2:.1f}" y="{HEIGHT - 8}">{escape(x_axis.label)}</text>'
    )
    middle = (TOP + bottom) / 2
    parts.append(
        f'<text class="ylabel" x="14" y="{middle:.1f}" transform="rotate(-90 14 {middle:.1f})">'
        f"{escape(y_axis.label)}</text>"
    )
    return parts


def _line(points: Sequence[tuple[float, float]], colour: int, dashed: bool) -> str:
    if len(points) == 1:
        return _dots(points, colour)
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points) if points else ""
    return f'<path class="line s{colour}{" dashed" if dashed else ""}" d="{path}"/>'


def _band(low: Sequence[tuple[float, float]], high: Sequence[tuple[float, float]], colour: int) -> str:
    around = [*low, *reversed(high)]
    path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in around) + "Z" if around else ""
    return f'<path class="band s{colour}" d="{path}"/>'


def _dots(points: Sequence[tuple[float, float]], colour: int) -> str:
    path = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in points)
    kind = "dots fine" if len(points) > MANY else "dots"
    return f'<path class="{kind} s{colour}" d="{path}"/>'


def legend(series: Sequence[Series]) -> str:
    """Return what the colours mean, as HTML below the chart; nothing for a single unnamed series."""
    named = [(i, line) for i, line in enumerate(series) if line.label]
    if len(named) < 2:
        return ""
    keys = "".join(
        f'<li><span class="key s{(i if line.colour is None else line.colour) % COLOURS}'
        f'{" dashed" if line.dashed else ""}"></span>{escape(line.label)}</li>'
        for i, line in named
    )
    return f'<ul class="legend">{keys}</ul>'
