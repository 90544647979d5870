"""A claim of a page, and the tables of bench/results that it is held against."""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "bench" / "results"
FIGURE = re.compile(r"[+-]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


@dataclass(frozen=True)
class Claim:
    """Figures of a sentence. bound: they are not rounded but hold for all that was measured.

    words: of the page, its lines joined; a group for each figure. measured: the same from a table, in order.
    page: from the root of the repository.
    """

    words: str
    measured: Callable[[], Sequence[float]]
    bound: bool = False
    page: str = "docs/figures.md"


Row = dict[str, str]


@cache
def tables(name: str) -> list[tuple[str, list[Row]]]:
    """Tables of bench/results/NAME.md: the heading of each, and its rows by column.

    Columns of the same name are told apart by a number behind it.
    """
    tables_of_file: list[tuple[str, list[Row]]] = []
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
            tables_of_file.append((heading, []))
        elif line.startswith("|") and not re.match(r"\|[\s:|-]+\|$", line):
            tables_of_file[-1][1].append(dict(zip(titles, cells, strict=True)))
    return tables_of_file


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


def cell(name: str, column: str, *words: str, nth: int = 0, under: str | None = None) -> float:
    """A number of the one row that has all the words."""
    (cell_values,) = cells(name, column, *words, under=under)
    return cell_values[nth]


def line(name: str, words: str) -> list[float]:
    """The numbers of the one line of a file that the words match, one a group."""
    matches = re.findall(words, (RESULTS / f"{name}.md").read_text())
    assert len(matches) == 1, (name, words, matches)
    return [float(one) for one in (matches[0] if isinstance(matches[0], tuple) else matches)]


def stored(name: str) -> dict:
    """bench/results/NAME.json."""
    return json.loads((RESULTS / f"{name}.json").read_text())
