"""The wheel, installed elsewhere and run outside the repository."""

import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGES = ("imaging", "drivers", "capture", "calib", "recon", "rig")


def run(*command: str | Path, cwd: Path, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    if path is not None:
        # Found before the editable installation, which an environment for development has.
        environment["PYTHONPATH"] = str(path)
    done = subprocess.run(
        [str(part) for part in command],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=180,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel's contents, as pip unpacks them."""
    work = tmp_path_factory.mktemp("wheel")
    source = work / "source"
    source.mkdir()
    # A copy, so that the build leaves nothing in the repository.
    for package in PACKAGES:
        shutil.copytree(REPOSITORY / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "LICENSE"):
        shutil.copy(REPOSITORY / name, source)
    (source / "README.md").write_text("# rig\n")
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
    # By way of its wheel; uncompiled, since most of its modules are never imported here.
    options = ("--no-deps", "--no-build-isolation", "--no-compile", "--target", work / "site")
    run(*pip, "install", *options, source, cwd=work)
    return work / "site"


def test_the_wheel_holds_every_package_and_its_data(installed: Path) -> None:
    for package in (*PACKAGES, "drivers/sim", "recon/methods", "recon/splat", "rig/commands", "rig/report"):
        assert (installed / package / "__init__.py").is_file(), package
    for folder in (
        Path("rig", "report", "templates"),
        Path("recon", "exports", "templates"),
        Path("recon", "exports", "formats", "viewer"),
    ):
        names = {path.name for path in (REPOSITORY / folder).iterdir()}
        assert {path.name for path in (installed / folder).iterdir()} == names
    assert (installed / "recon" / "decide" / "cost" / "scene_curves.json").is_file()
    assert not [name for name in ("tests", "bench", "docs") if (installed / name).exists()]
    for package in PACKAGES:
        assert (installed / package / "py.typed").is_file()


def test_the_wheel_holds_the_licence(installed: Path) -> None:
    (facts,) = installed.glob("hdr_rig-*.dist-info")
    assert (facts / "licenses" / "LICENSE").read_bytes() == (REPOSITORY / "LICENSE").read_bytes()
    assert "License-Expression: Apache-2.0" in (facts / "METADATA").read_text().splitlines()


def test_the_source_distribution_can_test_itself(tmp_path: Path) -> None:
    source = tmp_path / "source"
    tracked = (
        run("git", "ls-files", "-z", cwd=REPOSITORY).stdout.split("\0")
        if (REPOSITORY / ".git").exists()
        else []
    )
    if not tracked:
        pytest.skip("not a checkout")
    for name in filter(None, tracked):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / name, source / name)
    build = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
    run(sys.executable, "-c", build, tmp_path, cwd=source)
    (archive,) = tmp_path.glob("hdr_rig-*.tar.gz")
    with tarfile.open(archive) as opened:
        held = {name.split("/", 1)[1] for name in opened.getnames() if "/" in name}
    assert {name for name in tracked if name and name != ".gitignore"} <= held


def test_it_runs_outside_the_repository(installed: Path, tmp_path: Path) -> None:
    done = run(sys.executable, "-m", "rig", "--version", cwd=tmp_path, path=installed)
    assert done.stdout.startswith("rig ")


def test_a_capture_and_a_page_can_be_made_with_it(installed: Path, tmp_path: Path) -> None:
    """The page needs the templates, found as package data; the modules must be those of the wheel.

    Dark frames: to render a scene from there, Numba would compile all kernels anew.
    """
    code = """
import rig, imaging, capture, rig.report.page
from pathlib import Path
home = Path(rig.__file__).parent.parent
assert all(str(home) in module.__file__ for module in (imaging, capture, rig.report.page)), home
print(home)
rig.report.page.environment().get_template("page.html")
from rig.__main__ import main
assert main(["capture", "--sim", "toy", "S", "--darks", "--frames", "1", "--json"]) == 0
"""
    done = run(sys.executable, "-c", code, cwd=tmp_path, path=installed)
    assert done.stdout.splitlines()[0] == str(installed)
    assert (tmp_path / "S" / "shots.jsonl").is_file()
