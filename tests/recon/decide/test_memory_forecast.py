"""Memory forecast of a training, against its own figure when it has read its first views."""

from pathlib import Path

import pytest

from imaging.compute import memory
from imaging.compute.threads import thread_count
from imaging.errors import InputError
from recon.data.dataset import Dataset, View
from recon.decide.cost import memory_need as module
from recon.decide.cost.budget import Budget
from recon.decide.cost.memory_need import ARENA, KERNELS, Need, fitting, forecast, in_use, need
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct
from recon.scene.harmonics import DEGREE
from recon.scene.ply import most_gaussians

ROOM = 64 << 30
OF_PROCESS = ARENA * thread_count() + KERNELS
"""Bytes that a process has beside what it has already, images and Gaussians."""


@pytest.fixture
def needs(monkeypatch: pytest.MonkeyPatch) -> list[Need]:
    """Every need that is worked out."""
    asked: list[Need] = []

    def recorded(*views, **how):
        asked.append(need(*views, **how))
        return asked[-1]

    monkeypatch.setattr(module, "need", recorded)
    return asked


def of(session: Path, room: int = ROOM, budget: str | None = None, **overrides: float) -> int:
    request = TrainingRequest(quality="draft", overrides=Overrides(**overrides), budget=Budget.of(budget))
    return forecast(session, room, thread_count(), request)


def test_it_is_what_the_training_itself_will_say(session_copy: Path, needs: list[Need]) -> None:
    total = of(session_copy, width=32, gaussians=5000)
    asked = Overrides(width=32, gaussians=5000, iterations=1, refine="none", environment=False)
    reconstruct(session_copy, TrainingRequest(quality="draft", overrides=asked, name="one"))
    said, trained = needs
    assert (said.images, said.gaussians, said.width) == (trained.images, trained.gaussians, trained.width)
    assert total == said.total
    assert not (session_copy / "decoded").exists()


def test_it_grows_with_gaussians_and_width(toy: Path) -> None:
    small = of(toy, width=32, gaussians=1000)
    assert of(toy, width=32, gaussians=1_000_000) > small + 100_000_000
    assert of(toy, width=64, gaussians=1000) != small


def looks(dataset: Dataset, train: int) -> tuple[list[View], dict[str, tuple[int, int]]]:
    """A view of each camera, and counts of that many views of each to train on."""
    firsts = list({view.camera: view for view in (*dataset.train, *dataset.held_out)}.values())
    return firsts, {view.camera: (train + 1, train) for view in firsts}


@pytest.mark.parametrize("budget", ["1000k", "300MB"])
def test_a_budget_takes_no_more_gaussians_than_there_are_pixels(toy_dataset: Dataset, budget: str) -> None:
    firsts, counts = looks(toy_dataset, 2)
    pixels = sum(2 * view.lens.width * view.lens.height for view in firsts)
    needed, _ = fitting(firsts, counts, ROOM, TrainingRequest(budget=Budget.of(budget)))
    assert needed.gaussians == need(firsts, counts, pixels, DEGREE).gaussians


def test_a_budget_in_bytes_takes_what_its_dearest_degree_does(toy_dataset: Dataset) -> None:
    firsts, counts = looks(toy_dataset, 10_000)
    budget = Budget.of("30MB")
    assert budget is not None
    degrees = range(DEGREE + 1)
    each = [need(firsts, counts, most_gaussians(budget.amount, degree), degree) for degree in degrees]
    needed, _ = fitting(firsts, counts, ROOM, TrainingRequest(budget=budget))
    assert needed.gaussians == pytest.approx(max(one.gaussians for one in each), rel=1e-3)
    asked = TrainingRequest(budget=budget, overrides=Overrides(degree=2))
    assert fitting(firsts, counts, ROOM, asked)[0].gaussians == each[2].gaussians


@pytest.mark.parametrize("budget", ["900k", "60MB"])
def test_a_budget_without_room_is_refused_with_one_that_fits(toy_dataset: Dataset, budget: str) -> None:
    firsts, counts = looks(toy_dataset, 10_000)
    needed, _ = fitting(firsts, counts, ROOM, TrainingRequest(budget=Budget.of(budget)))
    free = needed.images - needed.held + needed.gaussians // 2 + KERNELS
    with pytest.raises(InputError, match=r"give --budget \d+k\.") as refusal:
        needed.require("S", free)
    smaller = TrainingRequest(budget=Budget.of(str(refusal.value).split("--budget ")[1].rstrip(".")))
    fitting(firsts, counts, ROOM, smaller)[0].require("S", free)


def test_views_left_out_by_hand_are_read_and_not_trained_on(toy_dataset: Dataset) -> None:
    firsts, counts = looks(toy_dataset, 500)
    few = {name: (count, 10) for name, (count, _) in counts.items()}
    asked = TrainingRequest(quality="best", overrides=Overrides(views=10 * len(firsts)))
    assert in_use(counts, 10 * len(firsts)) == few
    assert fitting(firsts, counts, ROOM, asked) == fitting(firsts, few, ROOM, TrainingRequest(quality="best"))
    assert in_use(counts, None) == in_use(counts, 10_000) == counts


@pytest.mark.parametrize("views", [1, 2, 5, 17])
def test_views_in_use_are_shared_between_cameras_in_proportion(views: int) -> None:
    used = in_use({"a": (7, 6), "b": (3, 3), "c": (1, 0), "d": (9, 9)}, views)
    assert sum(train for _, train in used.values()) == views
    assert [count for count, _ in used.values()] == [7, 3, 1, 9]
    for (_, train), of in zip(used.values(), (6, 3, 0, 9), strict=True):
        assert abs(train - views * of / 18) < 1


def test_images_that_leave_no_room_are_counted_as_on_the_disk(toy_dataset: Dataset) -> None:
    views, kind = (*toy_dataset.train, *toy_dataset.held_out), QUALITIES["draft"]
    firsts = [next(view for view in views if view.camera == name) for name in {one.camera for one in views}]
    counts = {one.camera: (3, 2) for one in firsts}
    asked = TrainingRequest(quality="draft", overrides=Overrides(gaussians=kind.gaussians))
    held, stored = fitting(firsts, counts, ROOM, asked)
    assert not stored
    more = held.images - held.held + held.gaussians + KERNELS
    assert fitting(firsts, counts, more, asked) == (held, False)
    less, stored = fitting(firsts, counts, more - 1, asked)
    assert stored
    assert less.images < held.images


def test_what_fits_no_machine_is_refused_with_what_would(toy: Path) -> None:
    room = memory.resident() + OF_PROCESS + (60 << 20)
    with pytest.raises(InputError, match="give --set gaussians=") as raised:
        of(toy, room, gaussians=100_000)
    assert str(toy) in str(raised.value)
