"""Memory of a GPU: tables beside their forecast, what is refused, and where it was too little after all."""

import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

if not torch.cuda.is_available():
    os.environ["TRITON_INTERPRET"] = "1"  # read when Triton is first imported

from imaging.errors import InputError, ReconstructionError
from recon import reconstruct as stage
from recon.data.dataset import View
from recon.data.load import load
from recon.decide.cost import gpu_memory
from recon.decide.cost.budget import Budget
from recon.decide.cost.gpu_memory import PAIR, needed, require_room
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.decide.settings import asked_for
from recon.result.model import CHECKPOINT, MODEL
from recon.splat import Limits, SplatCamera
from recon.splat.raster_types import RasterInputs

GPU = torch.device("cuda", 0)


def test_a_pair_takes_what_is_forecast() -> None:
    """Tensors that a render holds for its gradient, and the slots of that."""
    pytest.importorskip("triton", reason="Triton is for Linux")
    from recon.splat.gpu import rasterizer, tiles

    device = "cuda" if torch.cuda.is_available() else "cpu"
    camera = SplatCamera([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]], 16.0, 16.0, 16, 4, 32, 8)
    tensors = [
        torch.zeros(80, 3),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(80, 1),
        torch.full((80, 3), 0.5),
        torch.full((80,), 0.1),
        torch.ones(80, 3),
    ]
    tensors = [tensor.to(device).requires_grad_() for tensor in tensors]
    render = rasterizer.rasterize_gpu(RasterInputs(*tensors, camera, None, Limits(), None))
    saved = rasterizer._Tables(*render.image.grad_fn.saved_tensors[7:])
    pairs = len(saved.slot)
    assert pairs == 160
    slots = 4 * rasterizer._SLOT * pairs
    taken = slots + sum(table.nbytes for table in (saved.slot, saved.rows, saved.stored))
    last_chunks = 4 * 2 * 128 + 4 * tiles.FIELDS * tiles.CHUNK
    assert 0.9 * PAIR * pairs < taken - last_chunks <= PAIR * pairs


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A GPU with so many bytes of `free` memory."""
    card = SimpleNamespace(free=0)
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (card.free, 10**12))
    monkeypatch.setattr(gpu_memory, "device_name", lambda device: "GeForce")
    return card


def test_gaussians_that_do_not_fit_are_refused_with_a_number_that_does(
    toy: Path, card: SimpleNamespace
) -> None:
    dataset = load(toy)
    request = TrainingRequest(overrides=Overrides(gaussians=4_000_000))
    settings = asked_for(dataset, "nh-3dgs", request, processes=1)
    whole = needed(64 * 48, 0, 4_000_000, 2)
    assert whole == pytest.approx(4e6 * (16 * 38 + 600 + 4 * PAIR), rel=0.01)
    card.free = whole // 2
    with pytest.raises(InputError) as refusal:
        require_room(dataset, settings, GPU)
    assert "of the memory of GeForce where" in str(refusal.value)
    count = int(re.findall(r"--set gaussians=(\d+)", str(refusal.value))[0])
    assert 1_900_000 < count < 2_000_000
    fewer = TrainingRequest(overrides=Overrides(gaussians=count))
    require_room(dataset, asked_for(dataset, "nh-3dgs", fewer, processes=1), GPU)
    card.free = 10**6
    with pytest.raises(InputError, match="give a smaller --set width, or put CUDA_VISIBLE_DEVICES= in front"):
        require_room(dataset, settings, GPU)
    require_room(dataset, settings, torch.device("cpu"))


@pytest.mark.parametrize("budget", ["1000k", "100MB"])
def test_a_budget_that_does_not_fit_is_refused_with_one_that_does(
    toy: Path, card: SimpleNamespace, budget: str
) -> None:
    dataset = load(toy)
    wide = replace(dataset, train=tuple(view_of(view, 4000, 3000) for view in dataset.train))

    def require(amount: str) -> None:
        request = TrainingRequest(budget=Budget.of(amount))
        require_room(wide, asked_for(wide, "nh-3dgs", request, processes=1), GPU)

    step = max(map(gpu_memory.step_bytes, wide.views))
    card.free = needed(12_000_000, step, 500_000, 2)
    with pytest.raises(InputError, match="give --budget ") as refusal:
        require(budget)
    smaller = re.findall(r"--budget (\d+k)", str(refusal.value))[0]
    assert smaller == "490k"
    require(smaller)


def view_of(view: View, width: int, height: int) -> View:
    """The same with a lens that draws pictures of that size."""
    return replace(view, lens=replace(view.lens, width=width, height=height))


def test_memory_that_ends_in_a_training_leaves_its_checkpoint(
    toy: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    train, session = stage.train, tmp_path / "session"
    shutil.copytree(toy, session, ignore=shutil.ignore_patterns("reconstructions"))

    def ends(training, dataset, plan, hooks, **options) -> None:
        train(training, dataset, plan, hooks, until=1, **options)
        hooks.save()
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.")

    overrides = Overrides(iterations=2, gaussians=60, width=32, refine="none", environment=False)
    request = TrainingRequest(quality="draft", overrides=overrides, name="memory")
    monkeypatch.setattr(stage, "train", ends)
    with pytest.raises(
        ReconstructionError, match=r"has too little memory for the training in .*memory: close"
    ):
        stage.reconstruct(session, request)
    folder = session / "reconstructions" / "memory"
    assert (folder / CHECKPOINT).is_file()
    assert not (folder / MODEL).exists()
    monkeypatch.setattr(stage, "train", train)
    iterations: list[int] = []
    stage.reconstruct(session, request, on_log=lambda line: iterations.append(line["iteration"]))
    assert (folder / MODEL).is_file()
    assert max(iterations) == 2
