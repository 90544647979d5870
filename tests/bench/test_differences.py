"""Differences between rows of a table: what counts as one sample, against sampling itself."""

import json

import numpy as np
import pytest

from bench.support import differences


def rows(values, views=3):
    """Rows of {(scene, seed): dB}, the same for every view."""
    return [
        {"scene": scene, "seed": seed, "views": [{"db": db} for _ in range(views)]}
        for (scene, seed), db in values.items()
    ]


def level(db, scenes=("demo", "gallery"), seeds=3):
    return {(scene, seed): db for scene in scenes for seed in range(seeds)}


def test_views_of_a_scene_are_no_samples_of_their_own():
    """Six trainings with a hundred views each tell no more than with one view each."""
    change = {**level(0.0), ("demo", 0): 0.3, ("gallery", 1): 0.6}
    few = differences.paired(rows(change, 1), rows(level(0.0), 1), "db")
    many = differences.paired(rows(change, 100), rows(level(0.0), 100), "db")
    assert many.error == pytest.approx(few.error)
    assert many.mean == pytest.approx(0.15)
    assert many.by_scene == pytest.approx({"demo": 0.1, "gallery": 0.2})


def test_a_gain_that_scenes_do_not_agree_on_is_none():
    """The figures that a tuned softplus has in bench/results/methods.md, by scene."""
    ours = {("demo", 0): 41.36, ("gallery", 0): 42.87}
    theirs = {("demo", 0): 41.37, ("gallery", 0): 42.57}
    gain = differences.paired(rows(ours), rows(theirs), "db")
    assert gain.mean == pytest.approx(0.145)
    assert gain.error == pytest.approx(0.155)
    assert not gain.agreed
    assert gain.words(1) == "+0.1 +- 0.2, scenes disagree"


@pytest.mark.parametrize("between", [0.0, 0.5])
def test_its_error_is_that_of_repeating_everything(between):
    """2000 times four scenes of three rigs, whose effect differs by scene and by rig."""
    rng = np.random.default_rng(1)
    scenes, gains = [f"scene {number}" for number in range(4)], []
    for _ in range(2000):
        effect = {scene: 1 + between * rng.standard_normal() for scene in scenes}
        ours = {
            (scene, seed): effect[scene] + 0.2 * rng.standard_normal()
            for scene in scenes
            for seed in range(3)
        }
        gains.append(differences.paired(rows(ours, 1), rows(level(0.0, scenes), 1), "db"))
    spread = np.std([one.mean for one in gains])
    stated = np.sqrt(np.mean([one.error**2 for one in gains]))
    # The larger of two estimates is somewhat too large where both are right; it is never too small.
    assert 0.95 * spread < stated < 1.3 * spread


def test_one_scene_and_one_training_say_what_they_can():
    base, one = level(0.0, ("demo",)), level(0.0, ("demo",))
    one |= {("demo", 0): 0.3}
    gain = differences.paired(rows(one), rows(base), "db")
    assert gain.error == pytest.approx(np.std([0.3, 0, 0], ddof=1) / np.sqrt(3))
    single = differences.paired(rows({("demo", 0): 1.0}), rows({("demo", 0): 0.5}), "db")
    assert (single.error, single.words(1)) == (None, "+0.5")
    assert differences.units(2, 3) == "2 scenes of 3 rigs each"
    assert differences.units(1, 1) == "1 scene of 1 rig"


def test_what_is_kept_beside_a_table_gives_its_figures_again():
    change = rows({("demo", 0): 0.25, ("demo", 1): 0.75, ("gallery", 0): 1.0, ("gallery", 1): 2.0})
    change[0]["views"][0]["db"] = float("nan")
    base = rows(level(0.0, seeds=2))
    stored = json.loads(
        json.dumps(differences.stored_rows({"ours": change, "theirs": base}, ["db"]), allow_nan=False)
    )
    again = differences.paired(stored["ours"], stored["theirs"], "db")
    assert again == differences.paired(change, base, "db")
    assert again.mean == pytest.approx(1.0)
