"""Standard streams that are not there, as cron, daemons and windows have it, or that nobody reads."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

CLOSED = [
    "2>&-",
    ">&-",
    "<&-",
    ">&- 2>&-",
    "<&- >&- 2>&-",
    "2>/dev/full",
    "2> >(exec true)",
    "> >(exec true)",
]
"""Redirections of the streams by a shell; the last two are pipes whose readers have gone."""


def shell(command: str, streams: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Run a Python program, or `rig` where it is words, with such streams."""
    return subprocess.run(
        ["bash", "-c", f"{command} {streams}"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=os.environ | environment,
    )


def rig_words(*words: object) -> str:
    code = "import sys; from rig.__main__ import main; sys.exit(main())"
    return " ".join([f"'{sys.executable}' -c '{code}'", *(f"'{word}'" for word in words)])


@pytest.mark.parametrize("streams", CLOSED)
def test_a_command_does_its_work(streams: str, toy: Path, tmp_path: Path) -> None:
    """A check with its progress: its page is the same as with streams that are there."""
    before = {path: path.read_bytes() for path in (toy / "raw").rglob("*.dng")}
    done = shell(rig_words("check", toy, "--json"), streams)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert {path: path.read_bytes() for path in before} == before
    if streams.startswith(("2>", "<&- <")) and ">&-" not in streams.replace("2>&-", ""):
        assert json.loads(done.stdout)["exit_code"] == 0


@pytest.mark.parametrize("streams", ["2>&-", "<&- >&- 2>&-", "2> >(exec true)", ">&-"])
def test_a_failure_keeps_its_exit_code(streams: str) -> None:
    done = shell(rig_words("check", "nosuch", "--json"), streams)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("streams", ["2>&-", ">&-", "<&- >&- 2>&-"])
def test_what_libraries_print_goes_into_no_file(streams: str, tmp_path: Path) -> None:
    """The next file that is opened does not get the descriptor of a stream that was closed."""
    (tmp_path / "program.py").write_text(
        "import os, sys\n"
        "from rig.terminal.streams import mend_standard_streams\n"
        "mend_standard_streams()\n"
        "with open(sys.argv[1], 'wb', buffering=0) as file:\n"
        "    for descriptor in (1, 2):\n"
        "        os.write(descriptor, b'a word of a library')\n"
        "    os.system('echo a word of a child; echo a word of a child >&2')\n"
        "    print('a word'); print('a word', file=sys.stderr); sys.stdin.read(1)\n"
        "    file.write(b'picture')\n"
    )
    done = shell(f"'{sys.executable}' '{tmp_path / 'program.py'}' '{tmp_path / 'file'}'", streams)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "file").read_bytes() == b"picture"


def test_a_result_that_finds_no_room_is_told() -> None:
    done = shell(rig_words("--version"), ">/dev/full")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    done = shell(rig_words("check", "nosuch", "--json"), ">/dev/full")
    assert (done.returncode, "Traceback" in done.stderr) == (2, False)


def test_a_program_without_a_console_may_ask_for_a_command(
    monkeypatch: pytest.MonkeyPatch, toy: Path
) -> None:
    from rig.__main__ import main

    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    assert main(["check", str(toy)]) == 0
    assert main(["check", "nosuch", "--json"]) == 2
