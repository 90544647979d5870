"""The commands of the README and of docs/rig.md, run in their order as one who just installed rig would.

What stands in for a user: four simulated cameras for a rig, a folder of their files for `photos/`, and
less of everything where the pages allow minutes. Nothing else of a command is changed. That all the others
are commands of rig tests/docs/test_commands.py tells.
"""

import multiprocessing
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from imaging.files.exr.reading import read_exr
from tests.conftest import fewer_features, fewer_rays

REPOSITORY = Path(__file__).resolve().parents[2]
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
OWN_RIG = (REPOSITORY / "docs" / "rig.md").read_text(encoding="utf-8")

SHORTER = {
    "--budget 5m": "--quality draft --set iterations=60",
    "--frames 12": "--frames 2",
    "--darks": "--darks --frames 2",
    "--flats": "--flats --frames 2",
    "--board": "--board --frames 6",
    ":1200,800,60,40": ":120,80,60,40",
}
"""Replacements for options to which the pages give minutes or megapixels."""
CAMERAS = {"init", "capture", "cameras"}
"""Commands that speak to cameras, which are simulated here."""
AT_HAND = (
    __name__,
    "calib.calibrate",
    "capture.check.check",
    "capture.simulated",
    "recon.measure.evaluate",
    "recon.reconstruct",
    "rig.view.pages.opening",
)
"""Modules that take longest to import."""
FRAMES = 2
"""Frames of the photographs: eight brackets."""


def blocks(heading: str) -> list[str]:
    """The indented lines of a section, without their comments."""
    section = README.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = re.findall(r"^    (\S.*)$", section, re.MULTILINE)
    return [" ".join(shlex.split(line, comments=True)) if "*" not in line else line for line in lines]


def until(heading: str) -> list[str]:
    """The commands in the fences of docs/rig.md before a heading."""
    before = OWN_RIG.partition(f"\n## {heading}")[0]
    fences = re.findall(r"^```sh\n(.*?)^```$", before, re.MULTILINE | re.DOTALL)
    return [" ".join(shlex.split(line, comments=True)) for line in "".join(fences).splitlines()]


def command_of(words: Sequence[str], folder: Path, environment: dict[str, str]) -> None:
    """In a process of its own, of which only the imports are those of others: a command there, as `-m rig`.

    With fewer rays a pixel and fewer features a picture, which are most of what the demo takes.
    """
    os.chdir(folder)
    os.environ.update(environment)
    for number, name in enumerate((os.devnull, OUTPUT, ERRORS)):
        os.dup2(os.open(name, os.O_RDWR | os.O_CREAT | os.O_TRUNC), number)
    from rig.__main__ import main

    with fewer_rays(), fewer_features():
        sys.exit(main(words))


OUTPUT, ERRORS = ".output", ".errors"


class Desk:
    """A folder with photographs and an activated environment, and a shell that works in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        bin_folder = folder / ".venv" / "bin"
        bin_folder.mkdir(parents=True)
        rig = bin_folder / "rig"
        rig.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m rig "$@"\n')
        rig.chmod(0o755)
        (bin_folder / "activate").write_text(f'PATH={shlex.quote(str(bin_folder))}:"$PATH"\n')
        self.environment = os.environ | {
            "PYTHONPATH": os.pathsep.join([str(REPOSITORY), os.environ.get("PYTHONPATH", "")]),
            "TERM": "dumb",
        }
        self.processes = multiprocessing.get_context("forkserver")
        self.processes.set_forkserver_preload(list(AT_HAND))

    def run(self, command: str) -> None:
        """A command, given to a process that has imported what it needs; else as `type_in`."""
        name, *words = self.type_in(f"printf '%s\\0' {command}").split("\0")[:-1]
        assert name == "rig"
        process = self.processes.Process(target=command_of, args=(words, self.folder, self.environment))
        process.start()
        process.join(280)
        said = f"{command}\n{(self.folder / OUTPUT).read_text()}\n{(self.folder / ERRORS).read_text()}"
        assert process.exitcode == 0, said
        assert "defect of rig" not in said

    def type_in(self, command: str) -> str:
        """Output of a command; it has to succeed, and to call nothing a defect."""
        done = subprocess.run(
            ["bash", "-c", f". .venv/bin/activate; {command}"],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
            timeout=280,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
        assert "defect of rig" not in done.stderr
        return done.stdout

    def look(self, command: str) -> None:
        """Run a command that serves until Ctrl-C, and end it so as soon as it says where."""
        with subprocess.Popen(
            ["bash", "-c", f". .venv/bin/activate; exec {command}"],
            cwd=self.folder,
            env=self.environment,
            stderr=subprocess.PIPE,
            text=True,
        ) as served:
            assert served.stderr is not None
            said, ended = "", False
            for line in served.stderr:
                said += line
                if "http://127.0.0.1" in line and not ended:
                    served.send_signal(signal.SIGINT)
                    ended = True
            assert served.wait(60) == 0, said
        assert "until Ctrl-C" in said


def stood_in(command: str) -> str:
    """A command of the README with what stands in for minutes and cameras."""
    for long, short in SHORTER.items():
        command = command.replace(long, short)
    words = command.split()
    return f"{command} --sim demo" if words[:1] == ["rig"] and words[1] in CAMERAS else command


@pytest.fixture(scope="module")
def desk(demo_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Desk:
    """A new user's, with two brackets of each of four cameras in photos/."""
    desk = Desk(tmp_path_factory.mktemp("desk"))
    for frame in range(FRAMES):
        shutil.copytree(demo_capture / "raw" / f"{frame:04d}", desk.folder / "photos" / f"{frame:04d}")
    return desk


def test_make_has_the_two_commands_that_begin() -> None:
    assert blocks("Begin") == ["make demo", "make test"]
    for target, command in (("demo", "rig demo demo/"), ("test", "pytest")):
        done = subprocess.run(
            ["make", "-n", target], cwd=REPOSITORY, capture_output=True, text=True, check=True, timeout=60
        )
        assert command in done.stdout


@pytest.mark.timeout(600)
def test_the_first_real_use(desk: Desk) -> None:
    commands = blocks("First real use")
    assert len(commands) > 6
    activate, first, *others = commands
    desk.type_in(f"{activate}; {first}")
    for command in others:
        act = desk.look if command.startswith("rig view") else desk.run
        act(stood_in(command))
    (scene,) = (desk.folder / "S" / "reconstructions").iterdir()
    assert (scene / "report.html").is_file()
    assert list((desk.folder / "merged").rglob("*.exr"))
    assert list((desk.folder / "renders").rglob("*.exr"))


@pytest.mark.timeout(600)
def test_a_rig_of_your_own(desk: Desk) -> None:
    if (desk.folder / "S").exists():
        (desk.folder / "S").rename(desk.folder / "first")
        shutil.rmtree(desk.folder / "merged")
    commands = until("6. ")
    assert len(commands) > 8
    for command in commands:
        # What the machine lacks, or the network, is not the page's fault.
        if command != "rig doctor" and "--camera" not in command:
            desk.run(stood_in(command))
    assert (desk.folder / "S" / "calibration" / "report.html").is_file()
    (light, *_) = (desk.folder / "merged").rglob("*.exr")
    assert read_exr(light).attributes["whiteLuminance"] > 0
