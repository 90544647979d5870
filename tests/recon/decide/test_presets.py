"""The presets against the fronts that were recorded for them, by bench/recon/presets.py."""

import runpy
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

import recon.decide.presets
from bench.recon import presets
from imaging.files import store
from recon.decide.presets import Quality

BENCH = Path(__file__).parents[3] / "bench"


def test_the_presets_lie_on_the_recorded_fronts() -> None:
    path = BENCH / "results" / "presets.json"
    if not path.is_file():
        pytest.skip("no fronts are recorded yet: bench/recon/presets.py --write takes hours")
    recorded = store.read_json(path)
    # As the file has them: other tests make them shorter for as long as they run.
    qualities = runpy.run_path(str(Path(recon.decide.presets.__file__)))["QUALITIES"]
    assert recorded["presets"] == {name: presets.as_trained(preset) for name, preset in qualities.items()}, (
        "the presets changed since: bench/recon/presets.py --write"
    )
    assert presets.verdict(recorded["rows"])["wrong"] == []


def test_of_many_views_a_preset_looks_at_each_often_enough_and_has_gaussians_for_it() -> None:
    quality = Quality(300, 20_000, 320, looks=10, each=200)
    assert [quality.iterations_of(views) for views in (1, 30, 31, 100)] == [300, 300, 310, 1000]
    assert [quality.gaussians_of(views) for views in (1, 100, 101)] == [20_000, 20_000, 20_200]


def scene(draft: float, standard: float, best: float, behind: float = 0.0) -> dict[str, Any]:
    """Presets of 2, 10 and 30 s and these dB, each so far behind the front."""
    db = {"draft": (2.0, draft), "standard": (10.0, standard), "best": (30.0, best)}
    return {
        "presets": {
            name: {"seconds": seconds, "db": value, "truth_db": None, "behind_db": behind}
            for name, (seconds, value) in db.items()
        }
    }


def test_presets_that_are_as_asked_pass() -> None:
    figures = presets.verdict([scene(35, 37.2, 38), scene(30, 33.3, 34.2)])
    assert figures["wrong"] == []
    assert figures["draft_times_faster"] == 15
    assert figures["standard_below_best_db"] == pytest.approx(0.9)


def test_what_is_wrong_with_presets_is_said_of_the_worst_scene() -> None:
    slow = scene(35, 36.5, 38, behind=0.6)
    slow["presets"]["draft"]["seconds"] = 10.0
    fine = scene(35, 37.2, 38)
    assert presets.verdict([fine, slow, fine])["wrong"] == [
        "draft lies 0.60 dB behind the front",
        "standard lies 0.60 dB behind the front",
        "best lies 0.60 dB behind the front",
        "draft is 3.0 times faster than best",
        "standard lies 1.50 dB below best",
    ]


def test_a_scene_without_all_presets_has_no_say() -> None:
    part = scene(35, 30, 38, behind=9.0)
    del part["presets"]["best"]
    assert presets.verdict([part])["scenes"] == 0
    assert presets.verdict([part])["wrong"] == []
    assert presets.verdict([part, scene(35, 37.5, 38)])["behind_db"]["best"] == 0.0


def test_fronts_are_drawn_from_what_is_recorded(tmp_path: Path) -> None:
    path = BENCH / "results" / "presets.json"
    if not path.is_file():
        pytest.skip("no fronts are recorded yet: bench/recon/presets.py --write takes hours")
    rows = store.read_json(path)["rows"]
    one, all_of_them = tmp_path / "new" / "one.png", tmp_path / "new" / "all.png"
    presets.draw(rows[:1], one)
    presets.draw(rows, all_of_them)
    with Image.open(one) as picture:
        width, height = picture.size
    assert width > height > 400
    assert one.read_bytes() != all_of_them.read_bytes()
