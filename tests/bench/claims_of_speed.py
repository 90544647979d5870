"""Claims of docs/speed-or-accuracy.md and docs/view.md on what time and Gaussians buy."""

from functools import partial

from recon.decide.presets import QUALITIES

from .claim import Claim as Claimed
from .claim import cell, cells, line, stored
from .figures_of_scenes import presets, wide

Claim = partial(Claimed, page="docs/speed-or-accuracy.md")
Viewer = partial(Claimed, page="docs/view.md")
MEMORY = "demo", "lego", "fox", "castle", "castle", "banana"


def below(quality: str) -> list[float]:
    """dB of every scene that a preset lies below best."""
    return [best - preset for best, preset in zip(presets("best", "db"), presets(quality, "db"), strict=True)]


def _frame(size: str, count: str, *drawn: str) -> list[float]:
    """Milliseconds of a frame on a GPU, forward and backward."""
    return [cell("gpu", "forward + backward, ms", size, count, what) for what in drawn]


CALIBRATED, GIVEN = r"([\d,]+) \| ([\d,]+)", r"given \|"
WAYS = {
    "castle": ("width", "calibrate: before", "after"),
    "banana": ("width", "calibrate: before", "after"),
    "fox": ("width", "calibrate: before", "after"),
    "lego": ("width",),
    "demo": ("width", "calibrate: before", "after"),
    "gallery": ("width", "calibrate: before", "after"),
}
"""Sets of the table of whole ways, and its columns that come first; lego has given poses."""


def _way(name: str) -> list[float]:
    """Figures of a row of the table of whole ways."""
    columns = *WAYS[name], "train: before", "after 1", "ratio", "dB: before", "after 3"
    return [cell("whole_ways", column, name) for column in columns]


CLAIMS = (
    *(
        Claimed(
            rf"\| {name} \| (\d+) \| {CALIBRATED if len(first) > 1 else GIVEN} \| "
            r"([\d,]+) \| ([\d,]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|",
            partial(_way, name),
        )
        for name, first in WAYS.items()
    ),
    Claimed(
        r"reaches ([\d.]+) dB on the castle and ([\d.]+) on lego, and Adam ([\d.]+) and ([\d.]+) after",
        lambda: [
            *(max(value for (value,) in cells("curvature", column, "curved")) for column in ("dB", "dB 1")),
            *(cells("curvature", column, "Adam", but="times")[0][0] for column in ("dB", "dB 1")),
        ],
    ),
    Claimed(
        r"image and gradients agree with the processor's to ([\de.-]+) \(",
        lambda: line("gpu", r"gradients ([\de.-]+)"),
    ),
    Claimed(
        r"takes ([\d.]+) ms and gsplat 1\.5\.3 takes ([\d.]+), with the cut-offs of 3DGS in both; one of "
        r"three million ([\d.]+) and ([\d.]+), and at 3840x2160 ([\d.]+) for ([\d.]+) and ([\d.]+) for "
        r"(\d\.\d+)",
        lambda: [
            value
            for size in ("1920x1080", "3840x2160")
            for count in ("1,000,000", "3,000,000")
            for value in _frame(size, count, "ours, 3DGS", "gsplat")
        ],
    ),
    Claimed(
        r"light of 2\^20 to 1 it takes ([\d.]+) and ([\d.]+) ms",
        lambda: [
            *_frame("1920x1080", "1,000,000", "luminance-aware"),
            *_frame("1920x1080", "3,000,000", "luminance-aware"),
        ],
    ),
    Claimed(
        r"Of 100,000 Gaussians it takes ([\d.]+) ms for ([\d.]+), since .* a render takes ([\d.]+) times the "
        r"memory of gsplat's, and ([\d.]+) times of a million",
        lambda: [
            *_frame("1920x1080", "100,000", "ours, 3DGS", "gsplat"),
            *(
                cell("gpu", "memory", "1920x1080", count, "ours, 3DGS")
                / cell("gpu", "memory", "1920x1080", count, "gsplat")
                for count in ("100,000", "1,000,000")
            ),
        ],
    ),
    Claimed(
        r"trains whole in (\d+) s to ([\d.]+) dB, and on two cores of a processor in (\d+) s to ([\d.]+)",
        lambda: [
            cell("gpu_scenes", name, "lego", device) for device in ("H200", "CPU") for name in ("s", "dB")
        ],
    ),
    Claimed(
        r"day of (\d+) small sessions of ten kinds, .* run in (\d+) parts, (\d+) of them killed",
        lambda: line("thousand", r"write`: (\d+) sessions .* in (\d+) parts, (\d+) of them killed"),
    ),
    Claimed(
        r"steps took ([\d,]+) s of processor time, and `rig batch` itself (\d+) s in (\d+) runs",
        lambda: [
            *line("thousand", r"steps of all sessions \| (\d+)"),
            *line("thousand", r"runs of parts \| (\d+)"),
            *line("thousand", r"itself, (\d+) runs of parts"),
        ],
    ),
    Claim(
        r"of lego below it takes (\d+) s on two cores and reaches ([\d.]+) dB over white",
        lambda: [cell("published", name, "lego", "draft") for name in ("s", "over white")],
    ),
    Claim(
        r"on lego it reaches ([\d.]+) dB after (\d+) minutes",
        lambda: [
            cell("published", "over white", "lego", "best"),
            cell("published", "s", "lego", "best") / 60,
        ],
    ),
    Claim(
        r"presets run (\d+), (\d+) and (\d+) iterations per training view",
        lambda: [preset.looks for preset in QUALITIES.values()],
    ),
    Claim(
        r"use at most (\d+), (\d+) and ([\d,]+) Gaussians per view\.",
        lambda: [preset.each for preset in QUALITIES.values()],
    ),
    Claim(
        r"train the demo in (\d+), (\d+) and (\d+) s to ([\d.]+), ([\d.]+) and ([\d.]+) dB",
        lambda: [
            presets(quality, key)[0] for key in ("seconds", "db") for quality in ("draft", "standard", "best")
        ],
    ),
    Claim(
        r"draft is (\d+) times faster",
        lambda: [
            min(
                best / draft
                for best, draft in zip(presets("best", "seconds"), presets("draft", "seconds"), strict=True)
            )
        ],
    ),
    Claim(r"and ([\d.]+) to ([\d.]+) dB below it", lambda: [min(below("draft")), max(below("draft"))]),
    Claim(
        r"on the castle 10,000 Gaussians reach ([\d.]+) dB after "
        r"250 iterations and (\d+) s, ([\d.]+) after 1,000 and (\d+) s; 40,000 reach ([\d.]+) and ([\d.]+)\.",
        lambda: [
            *(figure for n in ("250", "1,000") for figure in wide(n, "10,000")),
            *(wide(n, "40,000")[0] for n in ("250", "1,000")),
        ],
    ),
    Claim(
        r"takes ([\d.]+) of the processor seconds of a training that looks at whole views from the first "
        r"one on, and has ([\d.]+) dB less; the fruit ([\d.]+) and ([\d.]+) dB more; the video at 640 px "
        r"([\d.]+) and ([\d.]+) dB more; lego at 400 px ([\d.]+) and ([\d.]+) dB more; RAW brackets of the "
        r"demo's scene at 640 px ([\d.]+) and ([\d.]+) dB more",
        lambda: [
            abs(cell("half_size", column, name))
            for name in ("castle", "banana", "fox", "lego", "demo")
            for column in ("ratio", "gain, dB")
        ],
    ),
    Claim(
        r"(\d+) views of four RAW exposures .* peak at ([\d.]+) GB",
        lambda: [cells("many_views", name)[-1][0] for name in ("views", "peak, GB")],
    ),
    Claim(
        r"standard takes at most ([\d.]+) of its time",
        lambda: [
            max(
                usual / best
                for best, usual in zip(
                    presets("best", "seconds"), presets("standard", "seconds"), strict=True
                )
            )
        ],
    ),
    Claim(r"at most ([\d.]+) dB below; of", lambda: [max(below("standard"))], bound=True),
    Claim(r"of (\d+) trainings none", lambda: [sum(one["trainings"] for one in stored("presets")["rows"])]),
    Claim(
        r"more than ([\d.]+) dB better than a preset",
        lambda: [max(max(presets(quality, "behind_db")) for quality in ("draft", "standard", "best"))],
    ),
    Claim(
        r"trains `best` in ([\d.]+) of its iterations for ([\d.]+) dB",
        lambda: line("early_stop", r"(?m)^best: ([\d.]+) dB.*?; ([\d.]+) of")[::-1],
    ),
    Claim(
        r"`standard` in ([\d.]+) for ([\d.]+) \(",
        lambda: line("early_stop", r"(?m)^standard: ([\d.]+) dB.*?; ([\d.]+) of")[::-1],
    ),
    Claim(
        r"held in (\d+) % of (\d+) predictions",
        lambda: line("learning_curves", r"Of (\d+) forecasts (\d+) % hold")[::-1],
    ),
    Claimed(
        " ".join(rf"\| {name} \| ([\d,]+) \| ([\d,]+) \| ([\d.]+) \| ([\d.]+) \|" for name in MEMORY),
        lambda: [
            value
            for row in zip(
                *(
                    cells("memory", column)
                    for column in ("width, px", "Gaussians", "forecast, GB", "peak, GB")
                ),
                strict=True,
            )
            for (value,) in row
        ],
    ),
    Claim(r"\((\d+) trainings were within", lambda: [len(cells("memory", "forecast off, %"))]),
    Claim(
        r"trainings were within (\d+) %",
        lambda: [max(abs(one) for (one,) in cells("memory", "forecast off, %"))],
    ),
    Viewer(
        r"With ([\d,]+) Gaussians in a window of",
        lambda: line("viewer", r"write`: (\d+) Gaussians"),
    ),
    Viewer(r"The scene itself was drawn after ([\d.]+) s;", lambda: [cell("viewer", "s", "the first that")]),
    Viewer(
        r"takes (\d+) ms of processor time at the lowest resolution",
        lambda: line("viewer", r"processor time a picture, ms \| (\d+)"),
    ),
    Viewer(r"a load of ([\d.]+)\)", lambda: line("viewer", r"load ([\d.]+),")),
    Viewer(
        r"the first picture came after ([\d.]+) s, then (\d+) pictures a second, (\d+) px wide, "
        r"and the one of full size ([\d.]+) s after",
        lambda: [
            cell("viewer", "s", "a picture that the"),
            *(
                line("viewer", rf"{words} \| ([\d.]+)")[0]
                for words in ("pictures a second", "width, px", "stopped, s")
            ),
        ],
    ),
)
