"""The command line itself: help, versions, usage errors, JSON, and what it costs to start."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest
import typer

from rig.cli import COMMANDS, app

HEAVY = ("numpy", "torch", "cv2", "scipy", "pycolmap", "numba", "matplotlib", "PIL")


@pytest.mark.parametrize(
    "arguments", [["--help"], ["--version"], *([name, "--help"] for name in sorted(COMMANDS))]
)
def test_help_and_version_load_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys; from rig.__main__ import main; status = main(sys.argv[1:]); "
        f"print([name for name in {HEAVY} if name in sys.modules]); sys.exit(status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    assert done.stderr == ""


def test_help_loads_few_modules() -> None:
    """Limit the modules for a quick help: 120 of these are loaded by Python itself and typer."""
    code = (
        "import sys; from rig.__main__ import main; status = main(['--help']); "
        "from rig.first_use import _Module; "
        "print(sum(not isinstance(one, _Module) for one in sys.modules.values())); sys.exit(status)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    count = done.stdout.splitlines()[-1]
    assert int(count) < 330


PLAIN_NUMBER = "N"
UNITS = {"DB", "TIME", "STOPS", "PX", "PORT", "ISO", "HZ", "GB", "LUX"}


def numbers() -> list[tuple[str, Any]]:
    """Every option and argument that is a number, with its command."""
    group = typer.main.get_command(app)
    return [
        (name, parameter)
        for name, command in group.commands.items()
        for parameter in command.params
        if {int, float} & {parameter.type_descriptor.annotation}
    ]


def test_help_says_the_unit_of_every_number() -> None:
    """N is a number of what the help names; anything else is a unit."""
    assert len(numbers()) > 12
    for command, parameter in numbers():
        where = f"rig {command} {parameter.opts[0]}"
        assert parameter.help, where
        assert parameter.metavar in UNITS | {PLAIN_NUMBER}, f"{where}: a metavar has to tell the unit"


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_can_be_quiet(rig, name: str) -> None:
    assert "-q, --quiet" in rig(name, "--help")[1]


def test_importing_rig_loads_nothing_heavy() -> None:
    code = f"import sys, rig; dir(rig); print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "[]\n"


def test_version_is_that_of_the_package(rig) -> None:
    from importlib.metadata import version

    assert rig("--version") == (0, f"rig {version('hdr-rig')}\n", "")


def test_help_names_every_command_and_the_exit_codes(rig) -> None:
    code, out, err = rig("--help")
    assert (code, err) == (0, "")
    for name in ("demo", "capture", "import", "check", "calibrate", "reconstruct", "evaluate", "render"):
        assert f"\n  {name} " in out
    assert "Exit codes: 0 done; 1 a defect of rig; 2 " in out


def test_rig_alone_and_rig_help_print_the_help(rig) -> None:
    assert rig() == rig("--help") == rig("help")
    assert rig("help", "check") == rig("check", "--help")
    code, _, err = rig("help", "frobnicate")
    assert (code, err.count("\n")) == (2, 1)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_complete_commands_and_options(shell: str) -> None:
    def completion(words: str, instruction: str) -> str:
        environment = os.environ | {
            "_RIG_COMPLETE": f"{instruction}_{shell}",
            "COMP_WORDS": words,
            "COMP_CWORD": str(words.count(" ")),
            "_TYPER_COMPLETE_ARGS": words,
            "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        }
        code = "import sys; from rig.__main__ import main; sys.exit(main())"
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
            env=environment,
        )
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout

    assert "_RIG_COMPLETE" in completion("", "source")
    assert "calibrate" in completion("rig cal", "complete")
    assert "--only" in completion("rig calibrate --on", "complete")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_help_of_every_command_has_an_example_that_is_valid_usage(rig, name: str) -> None:
    code, out, err = rig(name, "--help")
    assert (code, err) == (0, "")
    (example,) = [line.strip() for line in out.splitlines() if line.strip().startswith("Example: ")]
    assert example.split()[:3] == ["Example:", "rig", name]
    assert "--json" in out
    # Told to parse and do nothing: an option that does not exist would be a usage error.
    code, out, err = rig(*example.split()[2:], "--help")
    assert (code, err) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["frobnicate"], "no such command 'frobnicate'"),
        (["check"], "missing argument"),
        (["check", "S", "--frobnicate"], "no such option: --frobnicate"),
        (["check", "S", "T"], "unexpected extra argument"),
        (["capture", "S"], "missing option '--sim'"),
        (["capture", "S", "--sim", "toy", "--frames", "0"], "'--frames'"),
        (["capture", "S", "--sim", "toy", "--bracket", "1,x"], "'--bracket'"),
        (["capture", "S", "--sim", "toy", "--bracket", "1,1"], "differ"),
        (["capture", "S", "--sim", "toy", "--seed", "-1"], "'--seed'"),
        (["reconstruct", "S", "--budget", "5 parsecs"], "write a time as 90s, 5m or 1h"),
        (["reconstruct", "S", "--budget", "0s"], "too short for training"),
        (["reconstruct", "S", "--budget", "5M"], "write a time as 90s, 5m or 1h"),
        (["reconstruct", "S", "--budget", "1KB"], "too small for a scene"),
        (["reconstruct", "S", "--budget", "0dB"], "out of range"),
        (["reconstruct", "S", "--method", "magic"], "'magic' is not one of"),
        (["calibrate", "S", "--only", "stars"], "'stars' is not one of"),
    ],
)
def test_wrong_usage_is_one_sentence_and_exit_2(rig, arguments: list[str], words: str) -> None:
    code, out, err = rig(*arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert words in err
    assert "--help`" in err


def test_stops_are_read_in_any_order() -> None:
    from rig.options.common import stops

    assert stops("2,-4,0.5") == (-4.0, 0.5, 2.0)
    assert stops("auto") == ()


def test_json_is_exactly_one_object_even_when_it_fails(rig, tmp_path) -> None:
    code, out, err = rig("check", str(tmp_path / "nowhere"), "--json")
    data = json.loads(out)
    assert code == 2
    assert data["command"] == "check"
    assert data["exit_code"] == 2
    assert data["error"] == err.rstrip("\n")


def test_json_stays_clean_when_libraries_print(tmp_path) -> None:
    """In a process of its own: what C and Python libraries print must not reach either stream."""
    code = """
import ctypes, os, sys, warnings
import capture.check.check
def noisy(session, on_progress):
    print("python on stdout"); print("python on stderr", file=sys.stderr)
    os.write(1, b"native on 1\\n"); os.write(2, b"native on 2\\n")
    ctypes.CDLL(None).puts(b"buffered by C")
    warnings.warn("a library is unhappy")
    from imaging.errors import InputError
    raise InputError("S is broken: fix it.")
capture.check.check.check = noisy
from rig.__main__ import main
sys.exit(main(["check", "S", "--json"]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60, cwd=tmp_path
    )
    assert done.returncode == 2
    assert json.loads(done.stdout) == {"command": "check", "exit_code": 2, "error": "S is broken: fix it."}
    assert done.stderr == "S is broken: fix it.\n"


def test_control_characters_in_names_do_not_reach_the_terminal(rig, tmp_path) -> None:
    folder = tmp_path / "evil\x1b[2J\x07\r\n\u202egnp.exe"
    code, _, err = rig("check", str(folder))
    assert code == 2
    assert err.count("\n") == 1
    assert err.rstrip("\n").isprintable()
    assert "evil\\x1b[2J\\x07\\r\\n\\u202egnp.exe is not a folder" in err


def test_a_name_that_is_not_unicode_is_told(tmp_path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rig", "check", b"caf\xe9", "--json"],
        capture_output=True,
        check=False,
        timeout=60,
        cwd=tmp_path,
    )
    assert done.returncode == 2
    assert b"caf\\udce9 is not a folder" in done.stderr
    assert "is not a folder" in json.loads(done.stdout)["error"]


def test_a_reader_that_goes_away_is_no_error(tmp_path) -> None:
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m rig --help | true; exit ${{PIPESTATUS[0]}}"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_doctor_lists_findings_and_what_to_fix(rig) -> None:
    code, out, _ = rig("doctor", "--json")
    assert code == 0
    report = json.loads(out)
    findings = {one["name"]: one for one in report["findings"]}
    assert {"libusb", "training", "torch"} <= set(findings)
    assert report["in_order"] == (not any(one["fix"] for one in findings.values()))
    code, out, _ = rig("doctor")
    for name in findings:
        assert name in out


def test_the_cameras_of_a_simulated_rig_are_listed(rig) -> None:
    code, out, _ = rig("cameras", "--sim", "toy")
    assert code == 0
    assert "SIM-RAW-001  hdr-rig Simulated PTP  (PTP at USB 001:001" in out
    assert "1/8000 to 30 s, f/2.8 to f/16, ISO 100 to 1600" in out
    code, out, _ = rig("cameras", "--sim", "toy", "--json")
    assert [one["identity"]["serial"] for one in json.loads(out)["cameras"]] == ["SIM-RAW-001", "SIM-RAW-002"]


def test_no_camera_is_no_error(rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.discovery._by_protocol", lambda *given: iter(()))
    code, out, _ = rig("cameras")
    assert (code, out) == (0, "No camera: rig doctor shows what is missing.\n")
