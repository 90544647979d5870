"""A time that has no room for the size of a preset gets that of a smaller one before it is refused."""

import re

import pytest

from imaging.errors import InputError
from recon.decide import decisions
from recon.decide.cost.budget import Budget
from recon.decide.cost.countdown import TooShort
from recon.decide.cost.probe import Probe
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality, downwards
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.result.model import read_model

FELL_BACK = "600 s leave no room for 64 px and 400 Gaussians: trained with 32 px and 200 Gaussians instead"


@pytest.fixture
def short(monkeypatch):
    """A draft half as wide as the preset standard, both of them short."""
    monkeypatch.setitem(QUALITIES, "draft", Quality(20, 200, 32))
    monkeypatch.setitem(QUALITIES, "standard", Quality(60, 400, 64))


@pytest.fixture
def paces(monkeypatch):
    """Seconds an iteration by the width of the pictures; what was measured is what is there."""

    def set_to(by_width: dict[int, float]) -> None:
        def pace(begin, dataset, *_):
            return by_width[max(view.lens.width for view in dataset.views)]

        monkeypatch.setattr(decisions, "pace_at_once", pace)

    return set_to


def test_presets_fall_back_on_those_that_are_smaller():
    assert downwards("best") == ("best", "standard", "draft")
    assert downwards("draft") == ("draft",)


def test_a_preset_that_does_not_fit_gets_the_size_of_the_next(session_copy, short, paces):
    paces({64: 100.0, 32: 1e-3})
    said: list[str] = []
    record = read_model(
        reconstruct(session_copy, TrainingRequest(budget=Budget(600.0, "s")), on_message=said.append)
    )
    assert (record.width, record.settings.max_width) == (32, 32)
    assert record.settings.max_gaussians <= 200
    assert record.iterations == 60
    assert [line for line in said if "instead" in line] == [f"{FELL_BACK}."]
    assert [rung.reason for rung in record.rungs if rung.name == "size of the preset"] == [FELL_BACK]


def test_one_that_fits_only_without_a_start_falls_back_as_well(session_copy, short, paces):
    """Fifty iterations of 8 s fit into 600 s, and do not after a start, which may take four tenths of it."""
    paces({64: 8.0, 32: 1e-3})
    assert read_model(reconstruct(session_copy, TrainingRequest(budget=Budget(600.0, "s")))).width == 32


def test_a_pace_that_was_misjudged_at_first_falls_back_later(session_copy, short, paces, monkeypatch):
    paces({64: 1e-3, 32: 1e-3})

    def probe(begin, dataset, *_, **__):
        return Probe(3, 100.0 if dataset.views[0].lens.width == 64 else 1e-3, None)

    monkeypatch.setattr(decisions, "probe", probe)
    assert read_model(reconstruct(session_copy, TrainingRequest(budget=Budget(600.0, "s")))).width == 32


def test_it_is_found_again_when_it_is_asked_for_again(session_copy, short, paces):
    paces({64: 100.0, 32: 1e-3})
    first = reconstruct(session_copy, TrainingRequest(budget=Budget(600.0, "s")))
    made = read_model(first).created
    paces({64: 1e-3, 32: 1e-3})
    assert reconstruct(session_copy, TrainingRequest(budget=Budget(600.0, "s"))) == first
    assert (read_model(first).created, read_model(first).width) == (made, 32)


@pytest.mark.parametrize(
    ("overrides", "smallest"), [(Overrides(), 32), (Overrides(width=64, gaussians=400), 64)], ids=["", "set"]
)
def test_what_does_not_fit_at_the_smallest_is_refused_with_the_least_time(
    session_copy, short, paces, overrides, smallest
):
    """Fifty iterations of 20 s, at once and in a time that is not all planned with; what is set stays."""
    paces({64: 100.0, 32: 20.0} | ({64: 20.0} if smallest == 64 else {}))
    with pytest.raises(TooShort, match="600 s are too short") as refused:
        reconstruct(session_copy, TrainingRequest(budget=Budget(600.0, "s"), overrides=overrides))
    assert isinstance(refused.value, InputError)
    least = int(re.findall(r"give --budget (\d+)s or more", str(refused.value))[0])
    assert least == pytest.approx(50 * 20.0 * 1.25 / 0.92, abs=60)
    assert not list(session_copy.glob("reconstructions/*/*"))


def test_what_is_set_by_hand_is_not_reduced(session_copy, short, paces):
    paces({64: 100.0, 32: 1e-3})
    folder = reconstruct(
        session_copy, TrainingRequest(budget=Budget(600.0, "s"), overrides=Overrides(gaussians=300))
    )
    assert (read_model(folder).width, read_model(folder).settings.max_gaussians) == (32, 300)
