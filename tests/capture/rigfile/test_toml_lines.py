"""The line of every key, against documents whose writer knows where it put what."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from capture.rigfile.toml_lines import key_lines, line_of

KEYS = st.sampled_from(
    ["a", "b-1", "serial", '"quoted # key"', "'lit [eral'", '"x.y"', "ключ".join(['"', '"'])]
)
SCALARS = st.sampled_from(
    [
        "1",
        "-2.5e3",
        "true",
        "1979-05-27T07:32:00Z",
        '"plain"',
        '"# no comment"',
        '"quote \\" and [bracket"',
        "'lit # eral \\'",
        '"""one\nline = 2\n[[camera]]\n"" \\" """',
        "'''\n# [x]\n'''",
        '"""""quoted"""""',
        "[]",
        "[\n  1, # ] a comment\n\n  2,\n]",
        '[ "]", \'[\', """\n]\n""" ]',
        "{ z = 1 }",
    ]
)
BETWEEN = st.sampled_from(["", "\n", "# note = 1\n", "  \t\n# [table]\n\n"])
AFTER = st.sampled_from(["", "  # behind", "\t#]"])


@st.composite
def documents(draw: st.DrawFn) -> tuple[str, dict[tuple[str | int, ...], int]]:
    """A valid document and the line of each of its headers and keys."""
    text, lines = "", {}
    count = {"camera": 0}

    def put(statement: str, path: tuple[str | int, ...]) -> None:
        nonlocal text
        text += draw(BETWEEN)
        lines[path] = text.count("\n") + 1
        text += statement + draw(AFTER) + "\n"

    def fill(table: tuple[str | int, ...]) -> None:
        for key in draw(st.lists(KEYS, unique=True, max_size=4)):
            (name,) = tomllib.loads(f"{key} = 1")
            put(f"{key} = {draw(SCALARS)}", (*table, name))

    fill(())
    for header in draw(st.lists(st.sampled_from(["camera", "camera", "alone", "deep"]), max_size=5)):
        if header == "camera":
            path = ("camera", count["camera"])
            put("[[camera]]", path)
            count["camera"] += 1
            fill(path)
            if draw(st.booleans()):
                put("[ camera . sub ]", (*path, "sub"))
                fill((*path, "sub"))
        elif (name := f"{header}{len(lines)}") and header == "alone":
            put(f"[{name}]", (name,))
            fill((name,))
        else:
            put(f"[{name}.'in ner']", (name, "in ner"))
            fill((name, "in ner"))
    return text, lines


@settings(max_examples=200)
@given(documents(), st.sampled_from(["\n", "\r\n"]))
def test_every_key_is_on_the_line_where_it_was_written(document, ending: str) -> None:
    text, written = document
    tomllib.loads(text)
    line_numbers = key_lines(text.replace("\n", ending))
    assert {path: line_numbers.get(path) for path in written} == written
    # What is told beyond that stands in arrays and inline tables, on the line of its key.
    for path in line_numbers.keys() - written.keys():
        assert line_numbers[path] == line_of(written, path)


@pytest.mark.parametrize(
    ("path", "line"),
    [(("a",), 1), (("a", 3), 1), (("t", "x"), 2), (("none",), 1), ((), 1), (("t", "x", 0, "y"), 2)],
)
def test_what_has_no_line_is_where_the_table_around_it_is(path, line: int) -> None:
    assert line_of(key_lines("a = [1]\n[t]\n"), path) == line


def test_dotted_keys_have_the_line_of_their_statement() -> None:
    assert key_lines("\na.b.c = 1\na.d = 2\n")["a", "b", "c"] == 2
    assert key_lines("\na.b.c = 1\na.d = 2\n")["a", "d"] == 3
