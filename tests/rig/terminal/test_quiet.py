"""--quiet and NO_COLOR: what is said to nobody, and what is never coloured."""

import io
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rig.terminal.progress import silenced, status_line


def test_quiet_prints_nothing_where_all_is_done(rig, scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.terminal.progress.GRACE", 0.0)
    code, out, err = rig("check", str(scene))
    assert code == 0
    assert out != ""
    assert err != ""
    assert rig("check", str(scene), "--quiet") == (0, "", "")
    assert rig("check", "-q", str(scene)) == (0, "", "")


def test_quiet_leaves_errors_what_is_missing_and_json(rig, toy: Path) -> None:
    code, out, err = rig("check", "nosuch", "--quiet")
    assert (code, out) == (2, "")
    assert "nosuch is not a folder" in err
    next((toy / "raw").rglob("*.dng")).write_bytes(b"torn")
    code, out, err = rig("check", str(toy), "--quiet")
    assert (code, out) == (3, "")
    assert "has 1 problem" in err
    assert rig("check", str(toy), "--quiet", "--json")[1].startswith("{")


def test_quiet_still_asks_a_person_for_what_has_to_be_done() -> None:
    stream = io.StringIO()
    with silenced(True), status_line(stream) as status:
        status.begin("capture")
        status("shooting", 1, 2)
        status.say("a remark")
        status.ask("Cover every lens. Then press Enter.")
    assert stream.getvalue() == "Cover every lens. Then press Enter.\n"
    with silenced(False), status_line(stream) as status:
        status.say("a remark")
    assert stream.getvalue().endswith("a remark\n")


COLOUR = re.compile(rb"\x1b\[(?:\d+;)*(?:3\d|4\d|9\d|10\d)(?:;\d+)*m")
"""Select Graphic Rendition that sets a colour (ECMA-48, 8.3.117)."""


def on_a_terminal(environment: dict[str, str]) -> bytes:
    """Output of a live status line."""
    code = (
        "import sys, time; from rig.terminal.progress import status_line\n"
        "with status_line(sys.stderr) as status:\n"
        "    status.begin('check'); status('reading', 1, 2)\n"
        "    status.say('a remark'); status.progress.refresh()\n"
    )
    master, slave = pty.openpty()
    inherited = {
        key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "TERM", "COLUMNS")
    }
    with subprocess.Popen(
        [sys.executable, "-c", code], stderr=slave, stdout=slave, stdin=slave, env=inherited | environment
    ) as process:
        os.close(slave)
        output = b""
        try:
            while part := os.read(master, 4096):
                output += part
        except OSError:  # the other side is closed
            pass
        os.close(master)
        assert process.wait() == 0
    return output


def test_no_color_is_honoured_on_a_terminal() -> None:
    coloured = on_a_terminal({"TERM": "xterm-256color"})
    plain = on_a_terminal({"TERM": "xterm-256color", "NO_COLOR": "1"})
    assert COLOUR.search(coloured)
    assert not COLOUR.search(plain)
    assert b"a remark" in plain
    assert b"1/2" in plain
