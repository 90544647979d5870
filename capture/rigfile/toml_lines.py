"""Line of each key in a TOML file, for error messages.

`tomllib` states lines of its own errors only. A file is cut here into its statements, a header or a pair of
key and value each, and every statement is read by `tomllib` itself: all that has to be known of TOML is
where strings, comments and brackets end (TOML 1.0.0, https://toml.io/en/v1.0.0).
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from typing import Any

Path = tuple[str | int, ...]
"""Keys, and indices into arrays, from the top of the document."""

_TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}'
    r"|'''.*?'{3,5}"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'"
    r"|#[^\n]*"
    r"|[\[\]{}\n]"
    r"|[^\[\]{}\n\"'#]+",
    re.DOTALL,
)


def key_lines(text: str) -> dict[Path, int]:
    """The line, from 1, on which each key and each table of a valid TOML document begins.

    What stands in an array or an inline table is on the line of the key that it belongs to.
    """
    lines: dict[Path, int] = {}
    sizes: dict[Path, int] = {}
    table: Path = ()
    for number, statement in _statements(text.replace("\r\n", "\n")):
        value = tomllib.loads(statement)
        if statement.startswith("["):
            table = _header(value, statement.startswith("[["), sizes)
            lines.setdefault(table, number)
        else:
            for path in _paths(value):
                lines.setdefault(table + path, number)
    return lines


def line_of(lines: Mapping[Path, int], path: Path) -> int:
    """The line of a key, or of the nearest table around it that has one; 1 for the document."""
    for length in range(len(path), 0, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return 1


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Each statement with the line on which it begins."""
    number = began = 1
    depth = 0
    parts: list[str] = []
    for token in (match[0] for match in _TOKEN.finditer(text + "\n")):
        if token == "\n" and depth == 0:
            statement = "".join(parts).strip()
            if statement:
                yield began, statement
            parts, began = [], number + 1
        elif not token.startswith("#"):
            depth += (token in "[{") - (token in "]}")
            parts.append(token)
        number += token.count("\n")


def _header(value: dict[str, Any], array: bool, sizes: dict[Path, int]) -> Path:
    """The path of a table; the name of an array of tables denotes its last one."""
    *outer, last = [name for name in list(_paths(value))[-1] if isinstance(name, str)]
    path: Path = ()
    for name in outer:
        path += (name,)
        if path in sizes:
            path += (sizes[path] - 1,)
    path += (last,)
    if array:
        sizes[path] = sizes.get(path, 0) + 1
        path += (sizes[path] - 1,)
    return path


def _paths(value: Any) -> Iterator[Path]:
    """The path of everything in a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (key,)
        for path in _paths(inner):
            yield (key, *path)
