"""Claims of docs/speed-or-accuracy.md on sets of few photographs."""

from functools import partial

from bench.real.counts import MOST
from bench.real.more_time import WIDTH
from recon.decide.steps.size import EACH, FLOOR
from recon.decide.trials import FEWEST_VIEWS, HELD_OUT

from .claim import Claim as Claimed
from .claim import cell, cells
from .figures_of_scenes import longer

Claim = partial(Claimed, page="docs/speed-or-accuracy.md")
FEW = "castle", "monstree", "banana", "brighton"
MORE = r"\+([\d.]+) \+- ([\d.]+)"


def _fewer(name: str) -> list[float]:
    """Gain of as many Gaussians as the views may have on a set of few photographs, dB, and its error."""
    return cells("real_counts", "gain, dB", name, "by views")[0]


CLAIMS = (
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
        rf"that makes {MORE} dB more than ([\d,]+) of a castle, {MORE} of a banana and, of a toy on which "
        rf"nothing was chosen, {MORE}\.",
        lambda: [*_fewer("castle"), MOST, *_fewer("banana"), *_fewer("ET")],
    ),
    Claim(
        rf"same rule would make {MORE} dB more of a tree, at ([\d.]+) less SSIM, and {MORE} of a drone's "
        r"flight \((\d+) px",
        lambda: [
            *_fewer("monstree"),
            -cells("real_counts", "gain, SSIM", "monstree", "by views")[0][0],
            *_fewer("brighton"),
            WIDTH,
        ],
    ),
)
