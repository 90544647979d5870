"""Every command that the README or a page of docs/ shows is one that rig has, with options that it takes."""

import re
import shlex
from pathlib import Path

import pytest
import typer.main

from rig.cli import app

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
COMMANDS = typer.main.get_command(app).commands
STANDS_FOR = re.compile(r"[A-Z]+(=[A-Z]+)?")
"""Placeholders for the reader: FILE, KEY=VALUE."""


def shown() -> list[tuple[str, str]]:
    """Document and command: lines of fences and of indented blocks, and code within sentences."""
    commands: list[tuple[str, str]] = []
    for path in DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        blocks = re.findall(r"^```sh\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        lines = [line for block in blocks for line in block.splitlines()]
        lines += re.findall(r"^    (\S.*)$", text, re.MULTILINE)
        fenceless = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
        flowing = " ".join(line for line in fenceless.splitlines() if not line.startswith("    "))
        lines += re.findall(r"`([^`]+)`", flowing)
        commands += [
            (path.name, line) for line in dict.fromkeys(lines) if re.match(r"rig [a-z]|torchrun ", line)
        ]
    return commands


def refused(line: str) -> str | None:
    """Reason why rig refuses a command line, as far as words show; None if it accepts it."""
    words = shlex.split(line, comments=True)
    name, *rest = words[words.index("rig") + 1 :]
    if name not in COMMANDS:
        return f"there is no rig {name}"
    command = COMMANDS[name]
    takes = {option for one in command.params if not getattr(one, "is_flag", True) for option in one.opts}
    if rest and rest[-1] in takes:  # a sentence that names an option
        rest.append("VALUE")
    context = typer.Context(command, info_name=name)
    try:
        values, surplus, _ = command.make_parser(context).parse_args(rest)
        for parameter in command.params:
            if "Path" not in str(
                parameter.type_descriptor.annotation
            ):  # what is at a place is another matter
                value = values.get(parameter.name)
                for one in value.split("|") if isinstance(value, str) else [value]:
                    if one is not None and not (isinstance(one, str) and STANDS_FOR.fullmatch(one)):
                        parameter.process_value(context, one)
    except typer.BadParameter as error:
        return error.format_message()
    except Exception as error:  # the usage errors of typer's parser have no common name that is public
        return repr(error)
    return f"{surplus} is too much" if surplus else None


@pytest.mark.parametrize(("document", "line"), shown())
def test_a_command_that_a_page_shows_is_one_that_rig_takes(document: str, line: str) -> None:
    assert refused(line) is None


@pytest.mark.parametrize(
    "line",
    [
        "rig frobnicate S",
        "rig calibrate S --frobnicate",
        "rig calibrate S T",
        "rig capture RIG.toml S --bracket sideways",
        "rig reconstruct S --quality finest",
        "rig reconstruct S --seed some",
        "rig calibrate S --only focus",
    ],
)
def test_what_rig_does_not_take_is_found(line: str) -> None:
    assert refused(line) is not None


def test_commands_are_found_in_all_ways_of_showing_them() -> None:
    commands = [(document, line.partition("  ")[0]) for document, line in shown()]
    assert ("README.md", "rig explain S") in commands
    assert ("rig.md", "rig calibrate S") in commands
    assert ("speed-or-accuracy.md", "torchrun --nproc-per-node 2 -m rig reconstruct S") in commands
    assert len(commands) > 60
