"""The `rig` command line: its commands, from one thin module each; stages are loaded when a command runs."""

from collections.abc import Callable
from typing import Annotated

import typer

from rig.commands import (
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
    reconstruct,
    render,
    simulate,
    trade,
    view,
)
from rig.terminal.result import CommandResult

EXIT_CODES = (
    "Exit codes: 0 done; 1 a defect of rig; 2 the input or the usage is at fault, nothing usable came out; "
    "3 done in part, what is missing is listed; 130 stopped by Ctrl-C. "
    "Progress goes to standard error. RIG_DEBUG=1 shows what libraries say."
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
    "bench": bench.bench,
    "simulate": simulate.simulate,
    "cameras": cameras.cameras,
    "doctor": doctor.doctor,
}

for name, command in COMMANDS.items():
    app.command(name)(command)
