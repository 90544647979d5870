"""Tables for a terminal, wrapped to its width."""

import shutil
from collections.abc import Iterable, Mapping, Sequence
from io import StringIO

from rig.terminal.text import plain

NARROW, WIDE = 60, 130
"""Columns of text that a table has at least, and at most."""


def columns_of_text() -> int:
    """Width of a table: that of the terminal, within bounds."""
    return min(max(shutil.get_terminal_size((100, 24)).columns, NARROW), WIDE)


def table(
    groups: Iterable[tuple[str, Sequence[tuple[str, ...]]]],
    columns: Sequence[str],
    ratios: Mapping[str, int],
) -> list[str]:
    """Rows under the titles of their groups, as lines; a column that is empty throughout is left out.

    ratios: how columns share a line; those that it does not name are as wide as what they hold.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    groups = list(groups)
    filled = [i for i in range(len(columns)) if any(row[i] for _, rows in groups for row in rows)]
    drawn = Table(box=SIMPLE_HEAD, pad_edge=False, expand=True)
    for i in filled:
        drawn.add_column(columns[i], ratio=ratios.get(columns[i]), overflow="fold")
    for title, rows in groups:
        if title:
            drawn.add_row(Text(f"{title}:"))
        for row in rows:
            # What files say is never read as markup.
            drawn.add_row(*(Text(plain(row[i])) for i in filled))
    stream = StringIO()
    Console(file=stream, width=columns_of_text(), color_system=None, legacy_windows=False).print(drawn)
    return [line.rstrip() for line in stream.getvalue().splitlines() if line.strip()]
