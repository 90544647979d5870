"""The scripts of examples/ do what their first line says."""

import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import rig

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """Output of an example."""

    def ran(name: str, *arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return capsys.readouterr().out

    return ran


def test_brackets_to_exr(run, toy: Path, tmp_path: Path) -> None:
    said = run("brackets_to_exr.py", toy / "raw", tmp_path / "S", tmp_path / "out")
    stops = [float(value) for value in re.findall(r"exr: ([\d.]+) stops", said)]
    files = list((tmp_path / "out").rglob("*.exr"))
    assert len(stops) == len(files) > 0
    assert min(stops) > 5


def test_camera_move(run, scene: Path, tmp_path: Path) -> None:
    opened = rig.open_scene(scene)
    run("camera_move.py", opened.folder, tmp_path / "move", 3)
    first, middle, last = (
        rig.read_exr(tmp_path / "move" / f"move.{frame:04d}.exr").rgb() for frame in range(3)
    )
    exact = opened.render(opened.views[0]) * np.float32(opened.exposure)
    assert np.allclose(first, exact, rtol=1e-3, atol=1e-4)
    assert not np.allclose(first, middle, rtol=0.1)
    assert not np.allclose(middle, last, rtol=0.1)


def test_how_many_gaussians(run, toy: Path) -> None:
    said = run("how_many_gaussians.py", toy, 100, 400)
    counts = [int(value.replace(",", "")) for value in re.findall(r"([\d,]+) Gaussians", said)]
    assert counts == [100, 400]
    assert len(re.findall(r"[\d.]+ dB of \d{4}/", said)) == 2


def test_every_example_has_a_test() -> None:
    named = Path(__file__).read_text(encoding="utf-8")
    assert [path.name for path in EXAMPLES.glob("*.py") if f'"{path.name}"' not in named] == []
