"""The language of the code: docstrings name their subject, words and names are the field's own.

A docstring begins with a verb or a noun phrase, no clause ("Whether it ..."), so that the first words of an
index say what each name is. The public functions have Google-style sections, of which the site makes tables.
"""

import ast
import inspect
import re
from functools import cache
from pathlib import Path

import pytest

import rig

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("imaging", "drivers", "capture", "calib", "recon", "rig", "bench", "examples")
NAMED = (*FOLDERS, "tests")
"""Folders whose variables say what they hold."""
CLAUSE = re.compile(
    r'^\s*r?"""\s*(?:As|By|From|How|If|Of|That|What|When|Where|Whether|Which|While|Who|Whoever|Whom|Whose|Why)\b',
    re.MULTILINE,
)
RIDDLE = re.compile(
    r"\b(?:[Tt]old|so many|(?:is|are) none|None: it is not|[Ww]hoever|[Nn]obody|before (?:white|black))\b"
)
UNNAMED = {"found", "kept", "left", "own", "seen", "told"}
SIDES = {"right", "top", "bottom"}
"""Beside one of these `left` is a side."""


@cache
def sources(folder: str) -> dict[str, str]:
    return {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted((ROOT / folder).rglob("*.py"))
    }


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_docstring_begins_with_a_verb_or_names_the_thing(folder: str) -> None:
    clauses = [
        f"{name}:{text.count(chr(10), 0, match.end()) + 1} {match[0].strip()}"
        for name, text in sources(folder).items()
        for match in CLAUSE.finditer(text)
    ]
    assert clauses == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_docstrings_comments_and_messages_have_no_riddles(folder: str) -> None:
    riddles = [
        f"{name}:{number} {match[0]}"
        for name, text in sources(folder).items()
        for number, line in enumerate(text.splitlines(), 1)
        if (match := RIDDLE.search(line))
    ]
    assert riddles == []


@pytest.mark.parametrize("folder", NAMED)
def test_a_name_says_what_it_is_of(folder: str) -> None:
    """Of modules, classes, functions, attributes, parameters and variables, private or not."""
    unnamed = []
    for name, text in sources(folder).items():
        if not UNNAMED & set(re.findall(r"[a-z]+", text.lower())):
            continue
        module = ast.parse(text)
        for scope in ast.walk(module) if UNNAMED & names_in(module) else ():
            if isinstance(scope, ast.Module | ast.ClassDef | ast.FunctionDef | ast.Lambda):
                bound, line = names_in(scope), getattr(scope, "lineno", 1)
                allowed = {"left"} if bound & SIDES else set()
                unnamed += [f"{name}:{line} {word}" for word in bound & UNNAMED - allowed]
    assert unnamed == []


def names_in(scope: ast.AST) -> set[str]:
    """All names that a scope or what lies in it gives, as words: without underscores before them."""
    given = set()
    for node in ast.walk(scope):
        if isinstance(node, ast.arg):
            given.add(node.arg)
        elif isinstance(node, ast.ClassDef | ast.FunctionDef):
            given.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            given.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            given.add(node.attr)
    return {word.strip("_").lower() for word in given}


@pytest.mark.parametrize("name", [name for name in rig.__all__ if name[0].islower()])
def test_a_public_function_describes_all_that_it_takes_and_gives(name: str) -> None:
    function = getattr(rig, name)
    function = getattr(function, "__wrapped__", function)
    text = inspect.getdoc(function) or ""
    section = text.partition("\nArgs:\n")[2].partition("\n\n")[0]
    parameters = inspect.signature(function).parameters
    assert [one for one in parameters if not re.search(rf"^    {one}: \S", section, re.MULTILINE)] == []
    returns = inspect.signature(function).return_annotation
    assert ("\nReturns:\n" in text) == (returns not in (None, "None"))
    assert "\nRaises:\n" in text
