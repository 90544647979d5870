"""Claims of docs/speed-or-accuracy.md on the gain by time and Gaussians, and of the README in its table."""

import math
from functools import partial

from recon.decide.presets import QUALITIES
from recon.decide.steps.size import EACH, FLOOR
from recon.decide.trials import FEWEST_VIEWS, HELD_OUT

from .claim import Claim as Claimed
from .claim import cell, cells, line, stored
from .figures_of_scenes import beside_peer, longer, presets, wide

Claim = partial(Claimed, page="docs/speed-or-accuracy.md")
Front = partial(Claimed, page="README.md")
Viewer = partial(Claimed, page="docs/view.md")
FEW = "castle", "monstree", "banana", "brighton"
FEWEST = "castle", "banana", "ET"
MORE = r"\+([\d.]+) \+- ([\d.]+)"
MEMORY = "demo", "lego", "fox", "castle", "castle", "banana"


def below(quality: str) -> list[float]:
    """dB of every scene that a preset lies below best."""
    return [best - preset for best, preset in zip(presets("best", "db"), presets(quality, "db"), strict=True)]


def _frame(size: str, count: str, *drawn: str) -> list[float]:
    """Milliseconds of a frame on a GPU, forward and backward."""
    return [cell("gpu", "forward + backward, ms", size, count, what) for what in drawn]


def _fewer(name: str, count: str) -> list[float]:
    """Gain of fewer Gaussians on a set of few photographs, dB, and its standard error."""
    return cells("real_counts", "gain, dB", name, count)[0]


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
    Claim(
        r"differs from draft by \+([\d.]+) \+- ([\d.]+) dB on a castle, \+([\d.]+) \+- ([\d.]+) on a tree, "
        r"\+([\d.]+) \+- ([\d.]+) on a banana and -([\d.]+) \+- ([\d.]+) on a drone's flight",
        lambda: [abs(figure) for pair in longer("dB", *FEW) for figure in pair],
    ),
    Claim(
        r"standard gains ([\d.]+) to ([\d.]+) dB on all four",
        lambda: [choose(gain for gain, _ in longer("confirmed", *FEW)) for choose in (min, max)],
    ),
    Claim(
        r"SSIM rises by ([\d.]+) to ([\d.]+)",
        lambda: [choose(gain for gain, _ in longer("SSIM", *FEW)) for choose in (min, max)],
    ),
    Claim(
        r"sets of (\d+) to (\d+) photographs, each held out once",
        lambda: [
            choose(cell("real_more_time", "views", name, "draft") for name in FEW) for choose in (min, max)
        ],
    ),
    Claim(
        r"have \+([\d.]+) \+- ([\d.]+) dB more on a castle, \+([\d.]+) \+- ([\d.]+) on a tree, "
        r"\+([\d.]+) \+- ([\d.]+) on a banana and \+([\d.]+) \+- ([\d.]+) on a drone's flight",
        lambda: [value for name in FEW for value in cells("real_all_views", "gain, dB", name)[0]],
    ),
    Claim(
        r"\((\d+) to (\d+) photographs, one seed, the error over views",
        lambda: [choose(cell("real_all_views", "views", name) for name in FEW) for choose in (min, max)],
    ),
    Claim(
        r"fewer than (\d+) views are there to train on.*?at most ([\d,]+) Gaussians for each of them, "
        r"or ([\d,]+)",
        lambda: [1 + HELD_OUT * (FEWEST_VIEWS - 1), EACH, FLOOR],
    ),
    Claim(
        rf"length, ([\d,]+) Gaussians make {MORE} dB more than ([\d,]+) of a castle, {MORE} of a banana "
        rf"and {MORE}",
        lambda: [
            10_000,
            *_fewer("castle", "10,000"),
            40_000,
            *_fewer("banana", "10,000"),
            *_fewer("ET", "10,000"),
        ],
    ),
    Claim(
        rf"on which nothing was chosen; ([\d,]+) make {MORE}, {MORE} and {MORE}",
        lambda: [20_000, *(value for name in FEWEST for value in _fewer(name, "20,000"))],
    ),
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
    Front(
        r"\| ([\d.]+) dB mu-law PSNR with the 99\.9th percentile of the light as its peak, ([\d.]+) dB with "
        r"the maximum; median error ([\d.]+) stops, ([\d.]+) in the darkest tenth, ([\d.]+) in the brightest "
        r"hundredth; (\d+) px, preset standard in (\d+) s",
        lambda: [
            cell("demo", column)
            for column in (
                "mu-law over the 99.9th percentile, dB",
                "over the brightest, dB",
                "stops, median",
                "darkest tenth",
                "brightest hundredth",
                "px",
                "s",
            )
        ],
    ),
    Front(
        r"\| (\d+) s of processor time; plain pycolmap takes (\d+) s \|",
        lambda: [
            cell("calibration_size", "s", "castle", program, under="Whole") for program in ("rig", "pycolmap")
        ],
    ),
    Front(
        r"\| ([\d,]+) s of processor time; plain pycolmap takes ([\d,]+) s; both",
        lambda: [
            cells("calibration_full_size", "processor s", program, but="freed")[0][0]
            for program in ("rig", "pycolmap")
        ],
    ),
    Front(
        r"the tree reach (\d+) to (\d+) dB\.",
        lambda: [
            math.floor(min(beside_peer(name, "PSNR, dB")[0] for name in ("castle", "monstree"))),
            math.ceil(max(beside_peer(name, "PSNR, dB")[0] for name in ("castle", "monstree"))),
        ],
    ),
    Front(
        r"close views of an object reach (\d+) dB",
        lambda: [math.floor(beside_peer("lego", "over white, dB")[0])],
    ),
    Front(r"castle ([\d.]+) dB \(OpenSplat ([\d.]+)\),", lambda: beside_peer("castle", "PSNR, dB")),
    Front(r"tree ([\d.]+) \(([\d.]+)\),", lambda: beside_peer("monstree", "PSNR, dB")),
    Front(r"lego ([\d.]+) \(([\d.]+)\);", lambda: beside_peer("lego", "over white, dB")),
    Front(
        r"\| ([\d.]+) dB at (\d+) px; published 3DGS has ([\d.]+) at",
        lambda: [cell("published", name, "lego", "best") for name in ("over white", "px", "3DGS")],
    ),
    Front(
        r"error of held-out views ([\d.]+) stops, ([\d.]+) in the darkest tenth",
        lambda: [
            cells("foreign", column, "room, RAW of 14 bits", under="Held-out")[-1][0]
            for column in ("stops", "darkest tenth")
        ],
    ),
    Front(
        r"\| (\d+) of (\d+) placed views have wrong poses",
        lambda: [sum(one[0] for one in cells("foreign_poses", key)) for key in ("wrong 1", "placed with")],
    ),
    Front(r"\| (\d+) captures killed", lambda: [sum(one[0] for one in cells("kill", "sessions"))]),
    Front(
        r"error ([\d.e-]+) in the worst pixel",
        lambda: [
            max(of[0] for of in cells("stability", "forward", "2^40 (12 decades)", under="Worst error"))
        ],
    ),
    Front(
        r"two cores \| ([\d.]+) ms",
        lambda: [cell("splat", "forward + backward, ms", "`recon.splat`", under="50,000 Gaussians")],
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
