"""`rig` and `python -m rig`: run a command, print its result, turn every failure into one sentence."""

import sys
from collections.abc import Sequence
from contextlib import suppress

from imaging.errors import StorageError
from rig.cli import run
from rig.terminal.failures import STOPPED, explained
from rig.terminal.result import CommandResult, print_json, print_result
from rig.terminal.start_time import set_start
from rig.terminal.streams import debugging, mend_standard_streams, silence_stdout


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `rig ARGUMENTS` (those of the process if None); the exit code."""
    set_start(process=arguments is None)
    if arguments is None:
        mend_standard_streams()
    words = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if words[0] == "help":
        words = [*words[1:], "--help"]
    as_json = "--json" in words
    name = next((word for word in words if not word.startswith("-")), "")
    for stream in (sys.stdout, sys.stderr):
        # A terminal that lacks a character shows another one in its place.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    try:
        result = run(words, name)
        if isinstance(result, CommandResult):
            return print_result(result, name, as_json)
        if result == STOPPED:
            raise KeyboardInterrupt
        return int(result or 0)
    except BaseException as error:
        if isinstance(error, SystemExit):
            if isinstance(error.__context__, BrokenPipeError):  # the reader of a help has seen enough
                silence_stdout()
                return 0
            # typer leaves like this once it has printed or installed a shell's completion.
            return error.code if isinstance(error.code, int) else 0
        if debugging():
            raise
        line, code = explained(error, words)
        if sys.stderr is not None:
            print(line, file=sys.stderr)
        if as_json:
            with suppress(StorageError):  # the first failure is the one that counts
                print_json({"command": name, "exit_code": code, "error": line})
        return code


if __name__ == "__main__":
    sys.exit(main())
