"""docs/turntable.md, run as it stands: masks, poses and scene against the simulator's truth."""

import re
import shlex
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drivers.sim.mounting import TURN_SPREAD
from drivers.sim.rig_settings import RIGS
from drivers.sim.rigs import simulate
from drivers.sim.scene.turntable import turntable_scene
from imaging.merge.masks import read_mask
from imaging.optics.lens import rays
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from recon.measure.truth import calibration_errors
from tests.conftest import fewer_features

SHORTER = ("--quality draft", "--quality draft --set iterations=60 --set environment=0")
"""Masks and poses are held to the truth; that the scene is trained is enough, without the trials by which
rig looks for far light."""
PAGE = (Path(__file__).parents[2] / "docs" / "turntable.md").read_text(encoding="utf-8")


def things(frames: Iterable[int]) -> Iterator[np.ndarray]:
    """Where the first camera of the simulator sees things and not the room, at each frame, bool [H, W]."""
    rig, scene = simulate("turntable"), turntable_scene(room=False)
    lens = rig.mounts[0].optics.lens
    x, y = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    of_pixels = rays(lens, np.stack([x.ravel(), y.ravel()], -1))
    for frame in frames:
        pose = rig.cam_from_world(0, frame)
        hit = np.isfinite(scene.depth(-pose[:3, :3].T @ pose[:3, 3], of_pixels @ pose[:3, :3]))
        yield hit.reshape(lens.height, lens.width)


@pytest.mark.timeout(600)
def test_the_turntable_of_the_page(rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    smaller = replace(RIGS["turntable"], width=320, height=240, samples=1)
    monkeypatch.setitem(RIGS, "turntable", smaller)
    with fewer_features():
        for line in re.findall(r"^```sh\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[0].splitlines():
            code, _, err = rig(*shlex.split(line.replace(*SHORTER), comments=True)[1:])
            assert code == 0, err
    session = Session.open(tmp_path / "S")
    record = read_calibration(session)

    # Masks show the things of their own stop, and hide the room but for a rim.
    shots = {shot.frame: shot for shot in session.shots("scene")}
    assert len(shots) == 24
    for (frame, shot), true in zip(shots.items(), things(shots), strict=True):
        assert shot.mask == f"masks/{frame:04d}/cam0.png"
        shown = read_mask(session.folder / shot.mask, shot.height, shot.width)
        assert (shown & true).sum() > 0.99 * true.sum()
        assert (shown & ~true).sum() < 0.1 * (~true).sum()

    # Turns differ from the stated ones by what the table misses.
    rungs = {rung.name: rung for rung in record.rungs}
    assert rungs["turntable_angles"].taken
    rms = float(re.search(r"by ([\d.]+) \(rms\)", rungs["turntable_angles"].reason)[1])
    assert 0.5 * TURN_SPREAD < rms < 1.5 * TURN_SPREAD

    # Poses about the things, as the simulator has them, and no point of the room.
    errors = calibration_errors(session.folder, record)
    assert len(record.views) == 24
    assert errors["pose_rotation_deg_max"] < 0.3
    assert errors["pose_translation_relative_max"] < 0.005
