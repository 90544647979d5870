"""The `rig` command line: its commands, from one thin module each; stages are loaded when a command runs."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import wraps
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rig.first_use import at_first_use
from rig.options.common import QuietOption
from rig.options.defaults import config_file, read_defaults
from rig.options.request import expanded
from rig.terminal.progress import silenced
from rig.terminal.result import CommandResult

EXIT_CODES = (
    "Exit codes: 0 done; 1 a defect of rig; 2 the input or the usage is at fault, nothing usable came out; "
    "3 done in part, what is missing is listed; 130 stopped by Ctrl-C. "
    "Progress goes to standard error. RIG_DEBUG=1 shows what libraries say. Defaults of your own are read "
    "from ~/.config/rig/config.toml, or the file that RIG_CONFIG names."
)

COMMANDS = (
    "demo", "init", "capture", "import", "check", "calibrate", "merge", "normals", "reconstruct", "evaluate",
    "explain", "render", "export", "view", "trade", "batch", "bench", "simulate", "node", "cameras", "doctor",
)  # fmt: skip
"""Functions of their names, in modules of their names; `import` is a word of Python's."""
KEYWORDS = {"import": "importing"}


class _Commands(Mapping[str, Any]):
    """Commands by name; the module of one is imported, and its options are read, when it is asked for."""

    def __init__(self) -> None:
        self._read: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in COMMANDS:
            raise KeyError(name)
        if name not in self._read:
            called = KEYWORDS.get(name, name)
            with at_first_use():
                command = getattr(import_module(f"rig.commands.{called}"), called)
            alone = typer.Typer(add_completion=False, rich_markup_mode=None)
            alone.command(name)(_with_quiet(command))
            self._read[name] = typer.main.get_command(alone)
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Group(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: Any = _Commands()


app = typer.Typer(
    name="rig",
    cls=_Group,
    help="From cameras to a high-dynamic-range 3D scene: capture, calibrate, reconstruct.\n\n"
    "Begin with: rig demo demo/",
    epilog=EXIT_CODES,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        import rig

        typer.echo(f"rig {rig.__version__}")
        raise typer.Exit


@app.callback()
def rig(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Options before the command."""


def _with_quiet(command: Callable[..., CommandResult]) -> Callable[..., CommandResult]:
    """A command that takes the options of its request one by one, and that --quiet silences."""
    parameters, expanded_command = expanded(command)

    @wraps(command)
    def run(*, quiet: bool, **options: Any) -> CommandResult:
        with silenced(quiet):
            result: CommandResult = expanded_command(**options)
            return replace(result, quiet=quiet)

    last = inspect.Parameter("quiet", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=QuietOption)
    parameters = [*parameters, last]
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def run(words: Sequence[str], name: str) -> CommandResult | int | None:
    """Return what the command in `words`, called `name`, returns; the user's file says what is not given.

    The file is not read where help is asked for, and by `rig doctor`, which says what is wrong with it.
    """
    group = typer.main.get_command(app)
    path = None if name in ("", "doctor") or {"-h", "--help"} & set(words) else config_file()
    defaults = {} if path is None else read_defaults(path, group, name)
    result: CommandResult | int | None = group.main(
        list(words), prog_name="rig", standalone_mode=False, default_map=defaults
    )
    return result
