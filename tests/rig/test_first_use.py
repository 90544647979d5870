"""Modules that a command names at its top, and that are loaded when it uses them."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rig import first_use
from rig.cli import COMMANDS, _Commands
from rig.first_use import at_first_use


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A package with a module that tells when it runs, one that fails, and two that need each other."""
    files = {
        "__init__": "",
        "told": "import sys\nsys.told.append(__name__)\nvalue = 3\n",
        "broken": "value = 1\nraise ValueError('broken')\n",
        "first": "from toystage.second import two\none = 1\n",
        "second": "from toystage import first\ntwo = 2\ndef both(): return first.one + two\n",
        "command": "from toystage import broken, first, second, told\nfrom toystage.told import value\n",
        "later": "from toystage import told\nfrom toystage import broken\n",
    }
    (tmp_path / "toystage").mkdir()
    for name, text in files.items():
        (tmp_path / "toystage" / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(first_use, "OURS", {"toystage"})
    monkeypatch.setattr(sys, "told", [], raising=False)
    yield "toystage"
    for name in [name for name in sys.modules if name.partition(".")[0] == "toystage"]:
        del sys.modules[name]


def test_a_module_runs_when_a_name_in_it_is_asked_for_and_once(package: str) -> None:
    with at_first_use():
        later = importlib.import_module(f"{package}.later")
        later.told  # noqa: B018
    assert sys.told == []
    assert later.told.__file__.endswith("told.py")
    assert sys.told == []
    assert (later.told.value, later.told.value) == (3, 3)
    assert sys.told == [f"{package}.told"]
    with pytest.raises(AttributeError, match="has no attribute 'other'"):
        later.told.other  # noqa: B018


def test_a_name_that_is_imported_is_loaded_and_modules_that_need_each_other_are(package: str) -> None:
    with at_first_use():
        command = importlib.import_module(f"{package}.command")
        assert command.value == 3
    assert sys.told == [f"{package}.told"]
    assert command.second.both() == 3


def test_a_module_that_fails_says_why_and_is_tried_again(package: str) -> None:
    with at_first_use():
        later = importlib.import_module(f"{package}.later")
        later.told  # noqa: B018
    with pytest.raises(ValueError, match="broken"):
        later.broken.value  # noqa: B018
    assert f"{package}.broken" not in sys.modules


def test_outside_of_the_block_modules_run_at_once(package: str) -> None:
    importlib.import_module(f"{package}.told")
    assert sys.told == [f"{package}.told"]


def test_commands_are_found_by_name_in_order() -> None:
    commands = _Commands()
    assert tuple(commands) == COMMANDS
    assert len(commands) == len(COMMANDS)
    assert "frobnicate" not in commands
    assert commands["import"] is commands["import"]
