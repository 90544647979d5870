"""The Containerfile, read line by line: what it copies is enough to build from, at locked versions."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
LINES = [
    line.split(maxsplit=1)
    for line in (REPOSITORY / "Containerfile").read_text().replace("\\\n", " ").splitlines()
    if line.strip() and not line.startswith("#")
]
BUILD, FINAL = (
    [number for number, (word, _) in enumerate(LINES) if word == "FROM"][part : part + 1][0]
    for part in (0, 1)
)
COPIED = [text.split() for word, text in LINES[BUILD:FINAL] if word == "COPY"]
PIP = next(
    part.strip()
    for word, text in LINES
    if word == "RUN"
    for part in text.split("&&")
    if "pip install" in part
)


def project() -> dict:
    return tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]


def test_every_instruction_is_one_and_bases_are_pinned() -> None:
    known = {"FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "ENTRYPOINT", "CMD"}
    assert {word for word, _ in LINES} <= known
    bases = {text.split()[0] for word, text in LINES if word == "FROM"}
    (base,) = bases
    version = re.search(r"/python:(\d+\.\d+)-slim-\w+$", base)
    assert version is not None
    assert project()["requires-python"] == f">={version[1]}"


def test_it_ends_without_root_and_asks_for_no_network_after_the_build() -> None:
    words = [word for word, _ in LINES[FINAL:]]
    assert words.index("USER") < words.index("ENTRYPOINT")
    user = next(text for word, text in LINES[FINAL:] if word == "USER")
    assert user not in ("0", "root")
    runs = " ".join(text for word, text in LINES[FINAL:] if word == "RUN")
    assert not re.search(r"\b(pip|apt|apt-get|curl|wget|git)\b", runs)
    environment = dict(
        pair.split("=", 1) for word, text in LINES[FINAL:] if word == "ENV" for pair in text.split()
    )
    # Any user may write there, so that --user works and the home of nobody is needed.
    assert environment["HOME"] == "/tmp"
    assert environment["NUMBA_CACHE_DIR"].startswith("/tmp/")
    entry = next(text for word, text in LINES[FINAL:] if word == "ENTRYPOINT")
    assert entry.strip('[]"') in project()["scripts"]


def test_every_dependency_has_a_version_in_the_lock_file() -> None:
    assert "-c constraints.txt" in PIP
    lines = (REPOSITORY / "constraints.txt").read_text().splitlines()
    locked = {line.split("==")[0].lower() for line in lines if "==" in line}
    names = {re.match(r"[\w-]+", one)[0].lower() for one in project()["dependencies"]}
    assert names <= locked


def test_what_is_copied_is_enough_for_pip(tmp_path: Path) -> None:
    """The command of the file but for what it would fetch, on what it copies."""
    for *sources, place in COPIED:
        for source in sources:
            at = tmp_path / place if place != "./" else tmp_path / source
            if (REPOSITORY / source).is_dir():
                shutil.copytree(REPOSITORY / source, at, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(REPOSITORY / source, at)
    command = PIP.split()[1:]  # without the Python of the image
    offline = ["--dry-run", "--no-deps", "--no-index", "--no-build-isolation"]
    done = subprocess.run(
        [sys.executable, "-m", "pip", *command, *offline],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "hdr-rig" in done.stdout
    settings = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]
    packages = {pattern.rstrip("*") for pattern in settings["packages"]["find"]["include"]}
    assert packages <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize("name", ["docs/batch.md", "Containerfile"])
def test_the_command_that_is_shown_has_neither_network_nor_root(name: str) -> None:
    text = (REPOSITORY / name).read_text()
    (command,) = re.findall(r"podman run .*", text)
    assert "--network none" in command
    assert '--user "$(id -u):$(id -g)"' in command
