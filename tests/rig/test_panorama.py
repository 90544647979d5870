"""docs/panorama.md, run as it stands: its light, its sun and its figures, against the simulator's truth."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import rig as toolkit
from calib.exports.panorama.layout import directions
from drivers.sim.rigs import simulate
from drivers.sim.scene.court import EYE
from imaging.optics.pose import Pose
from imaging.session.calibration import read_calibration
from tests.conftest import fewer_rays

PAGE = (Path(__file__).parents[2] / "docs" / "panorama.md").read_text(encoding="utf-8")
BLOCK, FINER = 6, 3
"""Texels along a side of a block in which light is compared; rays of the truth along a side of a texel."""
RIGHT = 0.02
"""Stops, as the page says."""
STOPS = [0, *range(3, 10), *range(15, 18)]
"""Below the brightest block, in which the court has surfaces: of the page as well."""


def fences(language: str) -> str:
    return "".join(re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def truth(session: Path, sky: "toolkit.ExrImage", rows: int) -> np.ndarray:
    """True light [rows, 2 * rows, 3] on the panorama, and the world of the calibration in the simulator's."""
    poses = json.loads((session / "truth" / "truth.json").read_text(encoding="utf-8"))["frames"]
    real = {one["frame"]: Pose.model_validate(one["cam_from_world"]["cam0"]).matrix() for one in poses}
    placed = {view.frame: view.cam_from_world.matrix() for view in read_calibration(session).views}
    assert len(placed) == len(real) == 12
    u, _, vt = np.linalg.svd(sum(real[frame][:3, :3].T @ placed[frame][:3, :3] for frame in placed))
    names = ("rig:longitude90", "rig:up", "rig:middle")
    axes = np.array([[float(part) for part in str(sky.attributes[name]).split()] for name in names])
    axes = axes @ (u @ vt).T
    assert np.degrees(np.arccos(axes[1, 2])) < 0.5  # up is up
    scene = simulate("nodal").scene
    light = np.empty((rows, 2 * rows, 3))
    for row in range(rows):
        ahead = directions(rows * FINER, row * FINER, (row + 1) * FINER) @ axes
        light[row] = scene.radiance(EYE, ahead).reshape(FINER, 2 * rows, FINER, 3).mean(axis=(0, 2))
    return light


def blocks(picture: np.ndarray) -> np.ndarray:
    """[a, b, BLOCK * BLOCK] of a picture [H, W], as far as whole blocks fill it."""
    height, width = (size // BLOCK for size in picture.shape)
    parts = picture[: height * BLOCK, : width * BLOCK].reshape(height, BLOCK, width, BLOCK)
    return np.swapaxes(parts, 1, 2).reshape(height, width, -1)


def test_the_panorama_of_the_page(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    printed = ""
    with fewer_rays("nodal"):
        for line in fences("sh").splitlines():
            words = shlex.split(line, comments=True)
            code, out, err = rig(*words[1:])
            assert code == 0, err
            printed += out
    assert "turns and no depth" in printed
    assert "Next: rig merge S --panorama" in printed
    sky = toolkit.read_exr("sky.exr")
    measured, mask = sky.rgb().astype(np.float64), sky.channels["mask"]
    rows = len(measured)
    real = truth(tmp_path / "S", sky, rows)
    assert sky.attributes["rig:units"] == "cd/m2"
    assert sky.attributes["rig:known"] == 1.0
    assert "A" not in sky.channels

    # Right in each stop of brightness, in cd/m2, wherever a block has one brightness rather than two.
    light, true = blocks(measured[..., 1]), blocks(real[..., 1])
    usable = (blocks(mask) == 0).all(-1) & (true.max(-1) < 3 * true.min(-1))
    error = np.log2(light.mean(-1)[usable] / true.mean(-1)[usable])
    below = np.log2(true.mean(-1)[usable])
    below = np.floor(below.max() - below).astype(int)  # whole stops below the brightest
    of_each = {stop: error[below == stop] for stop in range(STOPS[-1] + 1) if (below == stop).sum() > 3}
    assert list(of_each) == STOPS
    page = " ".join(PAGE.split())
    assert "the lamp (0), sky, walls and floor (3 to 9) and the inside of the shed (15 to 17)" in page
    assert f"the median error is below {RIGHT} stops" in page
    assert f"blocks of {BLOCK} by {BLOCK} pixels" in page
    medians = {stop: float(np.median(errors)) for stop, errors in of_each.items()}
    assert max(map(abs, medians.values())) < RIGHT, medians

    # The error is as large as it is said to be, or smaller: texels are averages.
    smooth = np.repeat(np.repeat(true.max(-1) < 1.1 * true.min(-1), BLOCK, 0), BLOCK, 1)
    inner = np.s_[: smooth.shape[0], : smooth.shape[1]]
    z = (measured - real)[inner][smooth] / np.stack([sky.channels[f"sigma.{c}"] for c in "RGB"], -1)[inner][
        smooth
    ]
    assert 0.3 < 1.4826 * np.median(np.abs(z[np.isfinite(z)])) < 1.2

    # The sun has its energy, and level ground the lux that it has in the court.
    code_of_page: dict = {}
    exec(fences("python"), code_of_page)
    said = capsys.readouterr().out
    lux = float(re.search(r"level ground gets (\d+) lx", said)[1])
    falls = code_of_page["falls"]
    assert lux == pytest.approx(float((real @ [0.2126, 0.7152, 0.0722] * falls[:, None]).sum()), rel=0.03)
    assert (mask == 33).sum() > 10
    assert "by --sun" in printed
    seam = float(re.search(r"views differ by ([\d.]+) stops", said)[1])
    assert seam < 0.01
