"""Claims of docs/figures.md on the path-traced yards."""

import statistics
from functools import partial

from .claim import Claim, cells


def _of_seeds(column: str, trained: str, kind: str) -> list[list[float]]:
    """The values of all seeds, of the low sun and the high sun."""
    suns = "low-sun", "high-sun"
    return [[row[0] for row in cells("yards", column, sun, kind, trained)] for sun in suns]


def _yards(column: str, trained: str, kind: str = "RAW brackets") -> list[float]:
    """Means over the seeds."""
    return [statistics.mean(values) for values in _of_seeds(column, trained, kind)]


def _with_errors(column: str) -> list[float]:
    """Means and their standard errors, of RAW brackets as decided."""
    both = _of_seeds(column, "as decided", "RAW brackets")
    return [f(one) for one in both for f in (statistics.mean, lambda x: statistics.stdev(x) / len(x) ** 0.5)]


def _by_standard(kind: str) -> list[float]:
    """Bands of the low sun and of the high sun by the preset standard."""
    columns = "darkest tenth", "brightest 1 %", "brightest 0.1 %"
    return [value for column in columns for value in _yards(column, "standard", kind)]


def _split(kind: str) -> list[float]:
    """As decided and with the colours of 3DGS, of the low sun and then of the high sun, band by band."""
    columns = "darkest tenth", "middle", "brightest 1 %", "brightest 0.1 %"
    return [
        value
        for column in columns
        for pair in zip(
            _yards(column, "as decided", kind), _yards(column, "colours of 3DGS", kind), strict=True
        )
        for value in pair
    ]


CLAIMS = (
    Claim(
        r"held-out light is ([\d.]+) ± ([\d.]+) and ([\d.]+) ± ([\d.]+) stops off in the darkest tenth, "
        r"where the goal is [\d.]+, "
        r"and ([\d.]+) and ([\d.]+) in the brightest hundredth, where it is [\d.]+ and where ([\d.]+) and "
        r"([\d.]+) would be without light from far away; in the brightest thousandth, the suns, it is "
        r"([\d.]+) and ([\d.]+) off",
        lambda: [
            *_with_errors("darkest tenth"),
            *_yards("brightest 1 %", "as decided"),
            *_yards("brightest 1 %", "no far field"),
            *_yards("brightest 0.1 %", "as decided"),
        ],
    ),
    Claim(
        r"the darkest tenth is ([\d.]+) and ([\d.]+) off after 1,000 iterations, and ([\d.]+) and ([\d.]+) "
        r"with chroma learned four times as fast",
        lambda: [
            *_yards("darkest tenth", "1,000 iterations"),
            *_yards("darkest tenth", "chroma four times as fast"),
        ],
    ),
    *(
        Claim(
            words + r" the darkest tenth is ([\d.]+) for ([\d.]+) and ([\d.]+) for ([\d.]+) off, the middle "
            r"([\d.]+) for ([\d.]+) and ([\d.]+) for ([\d.]+), the brightest hundredth ([\d.]+) for ([\d.]+) "
            r"and ([\d.]+) for ([\d.]+), the brightest thousandth ([\d.]+) for ([\d.]+) and ([\d.]+) for "
            r"(\d\.\d+)",
            partial(_split, kind),
        )
        for words, kind in (
            ("Of brackets", "RAW brackets"),
            ("Of one exposure a view, the five by turns,", "RAW, one exposure a view"),
        )
    ),
    *(
        Claim(
            words
            + r" is ([\d.]+) and ([\d.]+) off in the darkest tenth, ([\d.]+) and ([\d.]+) in the brightest "
            r"hundredth, ([\d.]+) and (\d\.\d+) in the brightest thousandth",
            partial(_by_standard, kind),
        )
        for words, kind in (
            ("By the preset standard, light of RAW brackets", "RAW brackets"),
            ("of one exposure a view it", "RAW, one exposure a view"),
            ("of JPEG brackets it", "JPEG brackets"),
        )
    ),
    Claim(
        r"HDR-GS has ([\d.]+) and ([\d.]+) in the darkest tenth, and ([\d.]+) and ([\d.]+) in the brightest "
        r"hundredth",
        lambda: [
            *_yards("darkest tenth", "as decided", "JPEG brackets"),
            *_yards("brightest 1 %", "as decided", "JPEG brackets"),
        ],
    ),
)
