"""The `rig` command line: its commands, from one thin module each; stages are loaded when a command runs."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from typing import Annotated, Any

import typer

from rig.commands import (
    batch,
    bench,
    calibrate,
    cameras,
    capture,
    check,
    demo,
    doctor,
    evaluate,
    explain,
    export,
    importing,
    init,
    merge,
    node,
    reconstruct,
    render,
    simulate,
    trade,
    view,
)
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

app = typer.Typer(
    name="rig",
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


COMMANDS: dict[str, Callable[..., CommandResult]] = {
    "demo": demo.demo,
    "init": init.init,
    "capture": capture.capture,
    "import": importing.import_,
    "check": check.check,
    "calibrate": calibrate.calibrate,
    "merge": merge.merge,
    "reconstruct": reconstruct.reconstruct,
    "evaluate": evaluate.evaluate,
    "explain": explain.explain,
    "render": render.render,
    "export": export.export,
    "view": view.view,
    "trade": trade.trade,
    "batch": batch.batch,
    "bench": bench.bench,
    "simulate": simulate.simulate,
    "node": node.node,
    "cameras": cameras.cameras,
    "doctor": doctor.doctor,
}


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


for name, command in COMMANDS.items():
    app.command(name)(_with_quiet(command))


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
