"""Every figure of the README's "What it reaches" is in the table that it comes from.

A sentence that changes has its claim here changed with it: `words` finds its figures, one group each, and
`found` computes them from bench/results. What a sentence says of its own conditions is among SETTINGS.
"""

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import fmean

import pytest

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "bench" / "results"
NUMBER = r"(?<![\w@^.-])\d[\d,]*(?:\.\d+)?(?:e-\d+)?(?!\w|\^)"
FIGURE = re.compile(r"[+-]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


@dataclass(frozen=True)
class Claim:
    """Figures of a sentence. bound: they are not rounded but hold for all that was measured.

    words: of the README, its lines joined; a group for each figure. found: the same from a table, in order.
    """

    words: str
    found: Callable[[], Sequence[float]]
    bound: bool = False


Row = dict[str, str]


@cache
def tables(name: str) -> list[tuple[str, list[Row]]]:
    """Of bench/results/NAME.md: the heading that a table stands under, and its rows by column.

    Columns of the same name are told apart by a number behind it.
    """
    found: list[tuple[str, list[Row]]] = []
    titles: list[str] = []
    heading = ""
    lines = (RESULTS / f"{name}.md").read_text().splitlines()
    for line, after in zip(lines, [*lines[1:], ""], strict=True):
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if line.startswith("#"):
            heading = line.lstrip("# ")
        elif re.match(r"\|[\s:|-]+\|$", after):
            titles = [
                f"{cell} {cells[:place].count(cell)}".removesuffix(" 0") for place, cell in enumerate(cells)
            ]
            found.append((heading, []))
        elif line.startswith("|") and not re.match(r"\|[\s:|-]+\|$", line):
            found[-1][1].append(dict(zip(titles, cells, strict=True)))
    return found


def cells(
    name: str, column: str, *words: str, under: str | None = None, but: str | None = None
) -> list[list[float]]:
    """The numbers of a column, cell by cell, in the rows that hold all the words, and not `but`.

    Of the first table, or of the first one under a heading.
    """
    table = next(rows for heading, rows in tables(name) if under is None or heading.startswith(under))
    rows = [
        row
        for row in table
        if all(any(word in cell for cell in row.values()) for word in words)
        and (but is None or but not in " ".join(row.values()))
    ]
    assert rows, (name, words)
    return [[float(one.replace(",", "")) for one in FIGURE.findall(row[column])] for row in rows]


def by_scene(name: str, scene: str, trained: str, coloured: str) -> float:
    """dB of a scene in the table by scene that follows a comparison."""
    (found,) = [
        one[scene]
        for one in tables(name)[1][1]
        if (one["trained on"], one["appearance"]) == (trained, coloured)
    ]
    return float(found)


def cell(name: str, column: str, *words: str, nth: int = 0, under: str | None = None) -> float:
    """A number of the one row that has all the words."""
    (found,) = cells(name, column, *words, under=under)
    return found[nth]


def line(name: str, words: str) -> list[float]:
    """The numbers of the one line of a file that the words match, one a group."""
    found = re.findall(words, (RESULTS / f"{name}.md").read_text())
    assert len(found) == 1, (name, words, found)
    return [float(one) for one in (found[0] if isinstance(found[0], tuple) else found)]


def stored(name: str) -> dict:
    """bench/results/NAME.json."""
    return json.loads((RESULTS / f"{name}.json").read_text())


def compared(name: str, trained: str, coloured: str) -> list[float]:
    """Difference and error, dB, of the row of a comparison that is of this input and this appearance."""
    (found,) = [
        one for one in tables(name)[0][1] if (one["trained on"], one["appearance"]) == (trained, coloured)
    ]
    return [float(one) for one in FIGURE.findall(found["dB"])][1:]


def presets(quality: str, key: str) -> list[float]:
    """Of every scene."""
    return [one["presets"][quality][key] for one in stored("presets")["rows"]]


def below(quality: str) -> list[float]:
    """dB of every scene that a preset lies below best."""
    return [best - own for best, own in zip(presets("best", "db"), presets(quality, "db"), strict=True)]


def rate_gains(iterations: str) -> list[float]:
    """dB of the light, scene by scene, between the usual rates and those nearest to what is taken."""
    gains = []
    for one in tables("learning_rates")[0][1]:
        if one["iterations"] == iterations:
            told = [FIGURE.findall(part) for part in one["factor: pictures / light, dB"].split(", ")]
            light = {float(factor): float(value) for factor, _, value in told}
            near = min(light, key=lambda factor: abs(math.log(factor / float(one["taken"]))))
            gains.append(light[near] - light[1.0])
    return gains


def few() -> float:
    """The most that colours of no direction gain of the light of few views, dB."""
    degrees = [[at[1] for at in cells("few_views", f"degree {degree}")] for degree in range(3)]
    return max(plain - other for plain, *others in zip(*degrees, strict=True) for other in others)


def noise_gains(views: str) -> list[float]:
    """RAW dB that whitened residuals gain, and its standard error."""
    return cells("rawnerf_protocol", views, "whitened, squares", but="three scales")[0][1:]


def gained() -> float:
    """Mean over the scenes of the ladder, dB."""
    of = [
        (one[0], mean[0])
        for one, mean in zip(cells("ladder", "scenes"), cells("ladder", "dB, mean"), strict=True)
    ]
    return sum(count * mean for count, mean in of) / sum(count for count, _ in of)


EXR, RAW = "merged EXR", "RAW brackets"
CLAIMS = (
    Claim(
        r"between views right to ([\d.]+) degrees and turns to ([\d.]+) in the median",
        lambda: [
            cell("calibration", key, "320 px, 0 EV", under="Scene")
            for key in ("direction, degrees", "rotation, degrees")
        ],
    ),
    Claim(r"preset standard ([\d.]+) dB from the true", lambda: [presets("standard", "truth_db")[0]]),
    Claim(
        r"Capture: ([\d,]+) simulated scenes",
        lambda: [sum(one[0] for one in cells("planner", "scenes, of these beyond the list"))],
    ),
    Claim(r"(\d+) captures killed", lambda: [sum(one[0] for one in cells("kill", "sessions"))]),
    Claim(
        r"noise of a sensor to ([\d.]+) %",
        lambda: [
            max(of[0] for key in ("gain %", "read noise %") for of in cells("sensor", key, but="0.2 DN"))
        ],
    ),
    Claim(r"\(([\d.]+) % where the noise", lambda: [cell("sensor", "read noise %", "0.2 DN")]),
    Claim(
        r"response of developed photographs to ([\d.]+) %",
        lambda: [max(of[0] for of in cells("response", "rig"))],
    ),
    Claim(
        r"placed to ([\d.]+) degrees and ([\d.]+) mm at worst",
        lambda: [
            max(of[2] for of in cells("calibration", key, but="calibrateMultiview"))
            for key in ("rotation, degrees", "translation, mm")
        ],
    ),
    Claim(
        r"AUC@1 of ([\d.]+) in the median, but to ([\d.]+) where",
        lambda: [cell("calibration", "AUC@1", f"320 px, {ev} EV", under="Scene") for ev in ("0", "-8")],
    ),
    Claim(
        r"alike (\d+) of (\d+) placed views stand wrongly, each of them warned of, where (\d+) of (\d+) did",
        lambda: [
            sum(one[0] for one in cells("foreign_poses", column))
            for column in ("wrong 1", "placed with", "wrong", "placed without")
        ],
    ),
    Claim(
        r"all (\d+) views are placed, right to ([\d.]+) degrees in the median, and held-out views are "
        r"([\d.]+) stops off, ([\d.]+) in the darkest tenth",
        lambda: [
            cells("foreign", column, "room, RAW of 14 bits", under=under)[-1][0]
            for column, under in (
                ("views", "Poses"),
                ("degrees, median", "Poses"),
                ("stops", "Held-out"),
                ("darkest tenth", "Held-out"),
            )
        ],
    ),
    Claim(
        r"views are ([\d.]+) stops off in the median, ([\d.]+) at the far background; merged brackets "
        r"come to ([\d.]+) dB with a chi-square of ([\d.]+)",
        lambda: [
            cells("foreign", column, "objects, RAW of 12 bits, poses given", under=under)[-1][0]
            for column, under in (
                ("stops", "Held-out"),
                ("background", "Held-out"),
                ("merged, dB", "Photographs"),
                ("chi-square", "Photographs"),
            )
        ],
    ),
    Claim(
        r"RAW mosaics is ([\d.]+) dB above 3DGS with tuned rates and ([\d.]+) \+- ([\d.]+) above 3DGS as pub",
        lambda: [
            compared("methods", EXR, "SH of 3DGS, tuned")[0],
            *compared("methods", EXR, "3DGS, as published"),
        ],
    ),
    Claim(
        r"merged mosaic a view it is ([\d.]+) \+- ([\d.]+) better",
        lambda: [
            -compared("methods", "merged mosaics", "luminance-chromaticity")[0],
            compared("methods", "merged mosaics", "luminance-chromaticity")[1],
        ],
    ),
    Claim(
        r"Bilinear demosaicking costs 3DGS ([\d.]+) dB",
        lambda: [
            compared("methods", "merged EXR, bilinear", "SH of 3DGS, tuned")[0]
            - compared("methods", EXR, "SH of 3DGS, tuned")[0]
        ],
    ),
    Claim(
        r"same mosaics it is ([\d.]+) \+- ([\d.]+) dB above 3DGS with tuned",
        lambda: compared("methods", RAW, "SH of 3DGS, tuned"),
    ),
    Claim(
        r"([\d.]+) \+- ([\d.]+) above 3DGS with its usual",
        lambda: compared("methods", RAW, "SH of 3DGS, usual rates"),
    ),
    Claim(
        r"scenes disagree: (-[\d.]+) dB on the demo, ([\d.]+) on the gallery",
        lambda: [
            by_scene("methods", scene, RAW, "luminance-chromaticity")
            - by_scene("methods", scene, RAW, "softplus of SH")
            for scene in ("demo", "gallery")
        ],
    ),
    Claim(
        r"noise gains ([\d.]+) and ([\d.]+) dB of RAW",
        lambda: [noise_gains(f"{views} views")[0] for views in (8, 12)],
    ),
    Claim(r"nothing at 4 \((-[\d.]+) \+- ([\d.]+)\)", lambda: noise_gains("4 views")),
    Claim(
        r"HDR-GS reaches ([\d.]+) dB from one exposure a view, where 3DGS, .*? has ([\d.]+)",
        lambda: [cell("hdr_nerf_protocol", "OE dB", f"{name}, Exp-1") for name in ("HDR-GS", "vanilla 3DGS")],
    ),
    Claim(
        r"come out within ([\d.]+) dB of those that it saw, the response within ([\d.]+) %",
        lambda: [
            max(
                cell("hdr_nerf_protocol", "OE dB", name) - cell("hdr_nerf_protocol", "NE dB", name)
                for name in ("HDR-GS, Exp-1", "HDR-GS, Exp-3")
            ),
            max(of[0] for of in cells("hdr_nerf_protocol", "response RMSE, %", "HDR-GS, Exp")),
        ],
        bound=True,
    ),
    Claim(
        r"radiance within ([\d.]+) dB of what NH-3DGS makes of the true light \(([\d.]+) from one",
        lambda: [
            cell("hdr_nerf_protocol", "HDR dB, aligned", "NH-3DGS on the true light")
            - cell("hdr_nerf_protocol", "HDR dB, aligned", f"HDR-GS, {which}")
            for which in ("Exp-3", "Exp-1")
        ],
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
    Claim(r"at most ([\d.]+) dB below; of", lambda: [max(below("standard"))], bound=True),
    Claim(r"of (\d+) trainings none", lambda: [sum(one["trainings"] for one in stored("presets")["rows"])]),
    Claim(
        r"more than ([\d.]+) dB better than a preset",
        lambda: [max(max(presets(quality, "behind_db")) for quality in ("draft", "standard", "best"))],
    ),
    Claim(r"that is worth ([\d.]+) to ([\d.]+) dB", lambda: [min(rate_gains("300")), max(rate_gains("300"))]),
    Claim(r"at 100 (\d) to (\d) \(five", lambda: [min(rate_gains("100")), max(rate_gains("100"))]),
    Claim(r"poses in training gains ([\d.]+) dB", lambda: line("refine", r"(?m)^0\.6 px: ([+-][\d.]+) dB")),
    Claim(
        r"trains `best` in ([\d.]+) of its iterations for ([\d.]+) dB",
        lambda: line("early_stop", r"(?m)^best: ([\d.]+) dB.*?; ([\d.]+) of")[::-1],
    ),
    Claim(
        r"`standard` in ([\d.]+) for ([\d.]+) \(",
        lambda: line("early_stop", r"(?m)^standard: ([\d.]+) dB.*?; ([\d.]+) of")[::-1],
    ),
    Claim(
        r"may have, (\d+) % were taken or left as (\d+) simulated",
        lambda: [
            *line("ladder", r"(?m)^([\d.]+) % of \d+ choices"),
            sum(one[0] for one in cells("ladder", "scenes")),
        ],
    ),
    Claim(
        r"lost more than ([\d.]+) dB, their pictures up to ([\d.]+) \(the mean gained ([\d.]+)\)",
        lambda: [
            -min(one[0] for one in cells("ladder", "truth, worst")),
            -min(one[0] for one in cells("ladder", "dB, worst")),
            gained(),
        ],
    ),
    Claim(
        r"need little are at least ([\d.]+) times faster or smaller",
        lambda: line("ladder", r"the least is ([\d.]+) times faster or smaller"),
    ),
    Claim(
        r"the demo and the gallery is ([\d.]+) and ([\d.]+) times",
        lambda: [cell("count", "ratio", name) for name in ("demo", "gallery")],
    ),
    Claim(r"views have up to ([\d.]+) dB more of the light", lambda: [few()]),
    Claim(
        r"is right to ([\de-]+) in the worst pixel",
        lambda: [
            max(of[0] for of in cells("stability", "forward", "2^40 (12 decades)", under="Worst error"))
        ],
    ),
)
SETTINGS = (
    r"24 views of a scene of 17\.7 stops",
    r"24 views of a scene, 320 px wide",
    r"one rig of 28 views of 160 px",
    r"simulated scene of 200 px",
    r"wider images \(1,280 px\), which the simulated cameras of 320 px",
    r"1,000 iterations, errors over scenes",
    r"at 300 iterations",
    r"at 100(?= \d)",
    r"where they are 0\.6 px off and nothing at 0\.3",
    r"within 0\.2 dB of the best light",
    r"4 to 8 views",
    r"at 8 and 12 views of a phone at night and nothing at 4",
    r"where Raw3DGS reports 3 dB",
)
"""What was measured, rather than what came of it."""


def section() -> str:
    """What the README says it reaches, its lines joined, without the block of bench/speed/splat.py."""
    text = (ROOT / "README.md").read_text()
    _, _, rest = text.partition("## What it reaches")
    own, _, _ = rest.partition("\n## ")
    own = re.sub(r"\n[^\n]*`python -m bench.speed.splat.*?<!-- /bench -->", "", own, flags=re.DOTALL)
    return " ".join(re.sub(r"!\[.*?\]\(.*?\)", "", own).split())


def agrees(shown: str, value: float, bound: bool) -> bool:
    """Whether a figure is the value rounded to its last digit; or, a bound, next above it."""
    digits, _, power = shown.replace(",", "").partition("e")
    unit = 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))
    over = (float(shown.replace(",", "")) - value) / unit
    return -1e-6 <= over < 1 if bound else abs(over) <= 0.5 + 1e-6


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: re.sub(r"\W+", " ", claim.words).strip()[:60])
def test_a_figure_is_in_its_table(claim: Claim) -> None:
    found = re.findall(claim.words, section())
    assert len(found) == 1, f"the README no longer says {claim.words!r}: change the claim with the sentence"
    shown = found[0] if isinstance(found[0], tuple) else (found[0],)
    values = claim.found()
    assert len(shown) == len(values)
    for figure, value in zip(shown, values, strict=True):
        assert agrees(figure, value, claim.bound), f"{figure} in the README, {value} in the table"


def test_every_figure_has_a_claim() -> None:
    text, told = section(), set[int]()
    for claim in CLAIMS:
        for match in re.finditer(claim.words, text):
            told |= {at for group in range(1, len(match.groups()) + 1) for at in range(*match.span(group))}
    for words in SETTINGS:
        (match,) = re.finditer(words, text)
        told |= set(range(*match.span()))
    lost = [text[max(0, match.start() - 40) : match.end() + 20] for match in re.finditer(NUMBER, text)
            if match.start() not in told]  # fmt: skip
    assert not lost, f"no claim traces {lost}"


def test_nothing_was_worse_than_said_in_words() -> None:
    """What the README says without a figure: never, none, at the bound."""
    assert {one[0] for one in cells("planner", "more than the optimum")} == {0}
    assert {one[0] for one in cells("kill", "failures")} == {0}
    assert cells("merge", "noise", "all clipped")
    noise = [one[0] for one in cells("merge", "noise", but="2^20 apart") if one]
    assert fmean(noise) == pytest.approx(1, abs=0.01)
    assert line("foreign_poses", r"with\s+them \d+ of \d+, (\d+) of these in silence") == [0]
    assert "scenes disagree" in str(tables("methods")[0][1][1])
    assert abs(line("refine", r"(?m)^0\.3 px: ([+-][\d.]+) dB")[0]) < 0.05
