"""What an evaluation has time for: as much as fits, evenly chosen, never less than one view."""

import json
import math
import shutil
from dataclasses import dataclass

import numpy as np
import pytest

from imaging.session.session import SPLIT, Session, brackets
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.measure import flip
from recon.measure.evaluate import evaluate
from recon.measure.flip import Flips, LightPair, Pair
from recon.measure.pace import Pace
from recon.reconstruct import reconstruct


@dataclass
class Clock:
    """Time that passes when it is said to."""

    now: float = 100.0

    def __call__(self) -> float:
        return self.now


def turns(count: int, seconds: float, until: float) -> list[int]:
    """Turns that are taken, each of which lasts so long, and whose first one tells how long that is."""
    clock = Clock(0.0)
    pace = Pace(count, until, clock)
    taken, expected = [], 0.0
    for turn in range(count):
        if pace.takes(expected):
            taken.append(turn)
            clock.now += seconds
            expected = seconds
    assert (pace.turns, pace.taken) == (count, len(taken))
    return taken


def test_all_turns_are_taken_where_there_is_time():
    assert turns(7, 1.0, math.inf) == list(range(7))
    assert turns(7, 1.0, 7.0) == list(range(7))


@pytest.mark.parametrize(("until", "most"), [(0.0, 1), (1.0, 1), (3.0, 3), (5.5, 5), (9.0, 9)])
def test_as_many_as_fit_are_taken_and_spread(until: float, most: int):
    taken = turns(20, 1.0, until)
    assert len(taken) == most
    assert taken[0] == 0
    gaps = np.diff([*taken, 20])
    assert most == 1 or gaps.max() - gaps.min() <= math.ceil(20 / most)


def test_turns_that_are_known_to_be_too_long_are_not_begun():
    clock = Clock(0.0)
    pace = Pace(3, 5.0, clock)
    assert not any(pace.takes(8.0) for _ in range(3))


def a_view(rng: np.random.Generator) -> tuple[list[Pair], LightPair]:
    """A picture, and light of ten stops, which HDR-FLIP looks at in as many exposures."""
    codes = rng.integers(0, 256, (2, 16, 20, 3), dtype=np.uint8)
    truth = np.full((16, 20, 3), 1.0, np.float32)
    truth[0, 0] = 1024.0
    visible = np.ones((16, 20), bool)
    return [Pair("a", codes[0], codes[1], visible)], LightPair(truth, truth, visible, 1.0)


def test_hdr_flip_is_forecast_by_flip_of_a_picture_and_left_out_where_it_is_too_long(monkeypatch):
    """FLIP of a picture takes a second here, HDR-FLIP ten; forty seconds have room for two of the latter."""
    clock, rng = Clock(), np.random.default_rng(0)

    def slow(ours, reference, visible, kind, parameters):
        clock.now += parameters.get("numExposures", 1)
        return np.zeros(int(visible.sum()), np.float32)

    monkeypatch.setattr(flip, "_compared", slow)
    for seconds, counts, said in (
        (math.inf, (4, 4), []),
        (30.0, (4, 2), ["HDR-FLIP of 2"]),
        (8.0, (4, 0), ["HDR-FLIP of none"]),
        (2.0, (2, 0), ["FLIP of 2", "HDR-FLIP of none"]),
    ):
        began = clock.now
        flips = Flips(4, began + seconds, clock)
        rows = [flips.of(*a_view(rng)) for _ in range(4)]
        rows_with = tuple(sum(name in row for row in rows) for name in ("flip", "hdr_flip"))
        assert (rows_with, flips.left_out()) == (counts, said)
        assert clock.now <= began + max(seconds, 1.0)


@pytest.fixture(scope="module")
def tested(toy, tmp_path_factory):
    """A scene of which three of six views are held out."""
    session = shutil.copytree(toy, tmp_path_factory.mktemp("pace") / "S")
    groups = list(brackets(Session.open(session).shots("scene")).values())
    files = [[shot.file for group in part for shot in group] for part in (groups[::2], groups[1::2])]
    split = {"schema_version": 1, "reason": "of the test", "train": files[0], "test": files[1]}
    (session / SPLIT).write_text(json.dumps(split))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(40, 600, 64))
        return reconstruct(session, TrainingRequest(quality="draft"))


def test_views_without_time_are_left_out_and_named_so_and_the_others_are_as_ever(tested):
    whole = evaluate(tested)
    assert (len(whole.views), whole.left_out) == (3, None)
    short = evaluate(tested, until=0.0)
    assert short.held_out == whole.held_out
    (view,) = short.views
    (same,) = (one for one in whole.views if one.view == view.view)
    assert view.raw_psnr == pytest.approx(same.raw_psnr, abs=1e-4)
    assert short.raw_psnr == view.raw_psnr
    assert short.left_out == (
        "1 of 3 held-out views are measured, HDR-FLIP of none, to finish the report in time: "
        "`rig evaluate` measures all."
    )
