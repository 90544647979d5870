"""docs/comp.md, run as it stands: what is shot, solved and trained is a toy session at hand."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import rig as toolkit

PAGE = (Path(__file__).parents[2] / "docs" / "comp.md").read_text(encoding="utf-8")
BEFORE = {"capture", "calibrate", "reconstruct"}
"""Commands that the session at hand has behind it; those of docs/rig.md are run by test_readme.py."""


def fences(language: str) -> str:
    return "".join(re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def test_the_comp_of_the_page(
    rig, scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.rename(tmp_path / "S")
    monkeypatch.chdir(tmp_path)
    commands = [shlex.split(line, comments=True) for line in fences("sh").splitlines()]
    assert {"merge", "export", "render"} == {words[1] for words in commands} - BEFORE
    for words in commands:
        if words[1] not in BEFORE:
            code, out, err = rig(*(word.replace("orbit:24", "orbit:2") for word in words[1:]))
            assert (code, err) == (0, ""), out
    names: dict = {}
    exec(fences("python"), names)
    # The scene at hand was trained for a moment.
    assert abs(float(re.search(r"render over plate: ([+-][\d.]+)", capsys.readouterr().out)[1])) < 0.5
    shot = toolkit.read_exr("handover/plates_as_shot/cam0.0000.exr")
    truth = toolkit.read_exr("S/truth/0000/cam0.exr").rgb() * shot.attributes["rig:exposureFactor"]
    lit = (truth > 0.1 * np.median(truth)).all(-1)
    lit[:6] = lit[-6:] = lit[:, :6] = lit[:, -6:] = False  # the corners came from the render
    # Warped twice, a picture of 64x48 pixels is softer than the truth; in the median it is the same light.
    assert abs(np.median(np.log2(np.maximum(names["delivered"][lit], 1e-6) / truth[lit]))) < 0.03
    frames = sorted(Path("move").rglob("orbit.*.exr"))
    assert len(frames) == 2
    header = toolkit.read_exr(frames[0]).attributes
    assert header["rig:exposureFactor"] == shot.attributes["rig:exposureFactor"]
