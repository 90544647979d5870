"""`rig simulate`: it says where it is, serves, and ends with Ctrl-C."""

import json
import re
import signal
import socket
import struct
import subprocess
import sys

import pytest

from rig.terminal.progress import PlainStatusLine


def test_it_says_where_it_is_serves_and_ends_with_ctrl_c() -> None:
    command = [sys.executable, "-m", "rig", "simulate", "--ptpip", "127.0.0.1:0", "--profile", "nikon-z6"]
    with subprocess.Popen(
        [*command, "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        told = next(line for line in process.stderr if "ptpip:" in line)
        found = re.search(r"Z 6 is at 127\.0\.0\.1:(\d+), try: .* ptpip:127\.0\.0\.1:\1:\1", told)
        assert found, told
        port = int(found[1])
        with socket.create_connection(("127.0.0.1", port), timeout=30.0) as link:
            link.sendall(struct.pack("<II", 8 + 22, 1) + bytes(22))
            assert struct.unpack("<II", link.recv(8))[1] == 2
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60.0)
    assert process.returncode == 0
    assert json.loads(out) == {
        "command": "simulate",
        "exit_code": 0,
        "profile": "nikon-z6",
        "serial": f"SIM-NIKON-Z6-{port}",
        "host": "127.0.0.1",
        "port": port,
        "shots": 0,
    }


def test_ctrl_c_ends_it_well_as_soon_as_it_says_where_it_is(rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(line: PlainStatusLine, said: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(PlainStatusLine, "say", interrupted)
    code, out, err = rig("simulate", "--ptpip", "127.0.0.1:0")
    assert (code, err) == (0, "")
    assert out == "Simulated PTP took 0 shots\n"


@pytest.mark.parametrize("text", ["15740", "127.0.0.1", "127.0.0.1:70000", "a b:1"])
def test_an_address_that_is_none_is_wrong_usage(rig, text: str) -> None:
    code, out, err = rig("simulate", "--ptpip", text)
    assert (code, out) == (2, "")
    assert "write an address as 127.0.0.1:15740" in err


def test_an_unknown_profile_lists_those_there_are(rig) -> None:
    code, _, err = rig("simulate", "--ptpip", "127.0.0.1:0", "--profile", "leica")
    assert code == 2
    assert "generic, canon-eos-6d, canon-eos-r7, nikon-z6, sony-a7m4" in err


def test_an_address_that_is_taken_is_told_before_anything_is_rendered(
    rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.sim.rigs.simulate", lambda *asked: pytest.fail("it was rendered"))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        code, _, err = rig("simulate", "--ptpip", f"127.0.0.1:{port}")
    assert code == 2
    assert f"127.0.0.1:{port} cannot be listened on (Address already in use): choose another one." in err
