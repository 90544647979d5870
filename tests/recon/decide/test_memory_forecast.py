"""Memory forecast of a training, against its own figure when it has read its first views."""

from pathlib import Path

import pytest

from imaging.compute import memory
from imaging.compute.threads import thread_count
from imaging.errors import InputError
from recon.data.dataset import Dataset
from recon.decide.cost import memory_need as module
from recon.decide.cost.budget import Budget
from recon.decide.cost.memory_need import ARENA, KERNELS, Need, fitting, forecast, need
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES
from recon.decide.request import TrainingRequest
from recon.reconstruct import reconstruct

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
    assert of(toy, width=32, budget="1000k") > small + 100_000_000
    assert of(toy, width=64, gaussians=1000) != small


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
