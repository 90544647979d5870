"""Folders of photographs that do not belong together are what they are called, and counted as that."""

import io

import numpy as np
import pytest
from PIL import Image

from bench.real.poses import strangers
from bench.real.poses.strangers import COPIES, LONG_SIDE, SETS, STRANGERS, folders, judged, noise, report
from bench.support.record import machine


@pytest.fixture
def sets(tmp_path, monkeypatch):
    """A blank photograph wherever a set has one."""
    files = {name: [tmp_path / f"{name}-{at:02d}.jpg" for at in range(20)] for name in SETS}
    for path in [path for paths in files.values() for path in paths]:
        Image.new("RGB", (80, 60)).save(path)
    monkeypatch.setattr(strangers, "photographs", files.__getitem__)


def test_folders_hold_strangers_where_they_are_said_to(sets):
    made = list(folders(tuple(SETS)))
    assert len({(folder.kind, folder.name) for folder in made}) == len(made)
    for folder in made:
        names = [name for name, _ in folder.pictures]
        assert len(set(names)) == len(names)
        belonging = len(names) - len(folder.strangers)
        expected = {
            "as it is": (SETS.get(folder.name), 0),
            "unrelated": (0, len(SETS)),
            "with strangers": (SETS.get(folder.name.split(",")[0]), STRANGERS),
            "with noise": (SETS.get(folder.name), STRANGERS),
            "one photograph, copied": (0, COPIES),
            "noise": (0, COPIES),
        }
        assert (belonging, len(folder.strangers)) == expected[folder.kind]


def test_noise_has_something_at_every_size():
    picture = np.asarray(Image.open(io.BytesIO(noise(0))).convert("L"), float)
    assert picture.shape == (LONG_SIDE * 3 // 4, LONG_SIDE)
    halved = picture.reshape(60, 8, 80, 8).mean((1, 3))
    assert picture.std() > 20
    assert halved.std() > 10
    assert noise(0) != noise(1)


def test_a_stranger_is_wrong_unless_a_warning_names_it():
    names = ["a.jpg", "b.jpg", "stranger-fox.jpg", "stranger-tree.jpg"]
    row = judged(names, ["b.jpg rests on few points", "stranger-tree.jpg is held by one pair"])
    assert (row["placed"], row["named"]) == (2, ["b.jpg"])
    assert row["strange"] == ["stranger-fox.jpg", "stranger-tree.jpg"]
    assert row["wrong"] == ["stranger-fox.jpg"]
    row |= {"kind": "with strangers", "name": "x", "photographs": 5, "strangers": 3, "refused": ""}
    table = report({"rows": [row, row], "machine": machine()})
    assert "| with strangers | 2 | 0 | 4 | 4 | 2 | 6 | 4 | 2 |" in table
