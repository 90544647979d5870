"""What pages take from the code itself when the site is built: commands, the public API, tables of figures.

A page asks for it by a comment on a line of its own: `<!-- generated: commands -->`.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import typer
import typer.main

import rig
from rig.cli import EXIT_CODES, app

ROOT = Path(__file__).parents[2]
ASKED = re.compile(r"^<!-- generated: (\w+) -->$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """The page's Markdown with what it asks for."""
    return ASKED.sub(lambda match: GENERATED[match[1]](), markdown)


def commands() -> str:
    """Every command: what it does, an example, its arguments and options."""
    group = typer.main.get_command(app)
    parts = []
    for name, command in group.commands.items():
        with typer.Context(command, info_name=f"rig {name}") as context:
            usage = context.get_usage().removeprefix("Usage: ")
        about, _, example = (command.help or "").partition("Example: ")
        parts += [f"## rig {name}", " ".join(about.split("\n\n", 1)[0].split()), _code(example or usage)]
        parts += [" ".join(text.split()) for text in about.split("\n\n")[1:] if text.strip()]
        parts.append("\n".join(["| argument or option | |", "|---|---|", *_parameters(command)]))
    return "\n\n".join([*parts, "## Exit codes", EXIT_CODES.removeprefix("Exit codes: ")])


def _parameters(command: Any) -> Iterator[str]:
    for parameter in command.params:
        if getattr(parameter, "hidden", False):
            continue
        record = parameter.get_help_record(typer.Context(command))
        if record is None or "--help" in parameter.opts:
            continue
        name, text = (" ".join(part.split()) for part in record)
        yield f"| `{name}` | {_plain(text)} |"


def _plain(text: str) -> str:
    """Help as Markdown shows it letter for letter, in a cell of a table."""
    return re.sub(r"[*_<>\[\]|`&]", lambda match: f"&#{ord(match[0])};", text)


def _code(text: str) -> str:
    return f"```sh\n{' '.join(text.split())}\n```"


def api() -> str:
    """Every public name of `import rig`, by what it is."""
    kinds: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": []}
    for name in rig.__all__:
        kind = "Errors" if name.endswith("Error") else "Classes" if name[0].isupper() else "Functions"
        kinds[kind].append(name)
    return "\n\n".join(
        f"## {kind}\n\n" + "\n\n".join(f"::: rig.{name}" for name in names) for kind, names in kinds.items()
    )


def scripts() -> str:
    """Each table of bench/results: what it is of, and the command that writes it."""
    rows = ["| measured | script |", "|---|---|"]
    for path in sorted((ROOT / "bench" / "results").glob("*.md")):
        text = path.read_text(encoding="utf-8")
        title = text.partition("\n")[0].lstrip("# ")
        script = re.search(r"`(python -m bench\.[^`]+)`", text)
        assert script, path
        rows.append(f"| [{title}](tables.md#{path.stem}) | `{script[1]}` |")
    return "\n".join(rows)


def tables() -> str:
    """All of bench/results, headings one level down, each to be linked to by the name of its file."""
    parts = []
    for path in sorted((ROOT / "bench" / "results").glob("*.md")):
        title, _, rest = path.read_text(encoding="utf-8").partition("\n")
        parts += [f"## {title.lstrip('# ')} {{#{path.stem}}}", re.sub(r"(?m)^#", "##", rest.strip())]
    return "\n\n".join(parts)


GENERATED: dict[str, Callable[[], str]] = {
    "commands": commands,
    "api": api,
    "scripts": scripts,
    "tables": tables,
}
