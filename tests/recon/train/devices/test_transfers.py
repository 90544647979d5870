"""Copies from and to the host in an iteration of a training on a GPU, and its waits.

Counted where the tensors are (forward, loss, backward, step of the optimizer) on a device that is pretended.
This sees copies between the devices, values that are read, and results whose size depends on values. It does
not see waits of a driver or of torch itself: for memory when torch's own is used up, for a kernel that is
compiled, for a page that is locked; nor how long any wait lasts. It takes torch's word that a copy with
`non_blocking` from memory that is not locked returns when the host's part is read.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imaging.sensor.cfa import Cfa
from imaging.session.calibration import Response
from recon.data.dataset import Dataset, Sensor, View
from recon.data.light import Light
from recon.data.shot import HeldPlanes, Shot
from recon.methods.method import Method
from recon.observe import targets
from recon.observe.linear import LinearLight, Observation
from recon.observe.photographs import ToneCurve
from recon.observe.refinement import Refined, Refinement
from recon.observe.tone_grid import curve_parameters
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.gaussians import Gaussians
from recon.splat import SplatCamera
from recon.train.densification import DensityRules
from recon.train.devices import ranks
from recon.train.monitor import Hooks
from recon.train.trainer import train
from recon.train.training import Plan, Training
from tests.recon.interpreter import quick_interpreter
from tests.recon.pretended_device import DEVICE, Counts, pretended

pytest.importorskip("triton", reason="Triton is for Linux")
pytestmark = pytest.mark.skipif(torch.cuda.is_available(), reason="Triton does not interpret on a GPU")

SIZE, COUNT = 8, 6


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    quick_interpreter(monkeypatch)


def make_view(kind: Any, glare: float) -> View:
    """Two exposures of the same noise, seen with alpha where they are photographs."""
    rng = np.random.default_rng(2)
    shape = (SIZE, SIZE) if kind == "raw" else (SIZE, SIZE, 3)
    none = np.zeros(shape, bool)
    alpha = None if kind == "raw" else np.ones((SIZE, SIZE), np.float32)
    shots = tuple(
        Shot(f"{k}", k, HeldPlanes(rng.uniform(0.1, 0.9, shape).astype(np.float32), none, none, ~none, alpha))
        for k in (0.5, 1.0)
    )
    motion = np.eye(4)
    motion[2, 3] = 2.0
    return View(
        camera="cam",
        frame=0,
        lens=SplatCamera(motion, 10.0, 10.0, SIZE / 2, SIZE / 2, SIZE, SIZE),
        sensor=Sensor(
            kind=kind,
            cfa=Cfa.RGGB if kind == "raw" else None,
            camera_from_rec709=np.eye(3),
            falloff=np.ones((SIZE, SIZE), np.float32),
            response=Response(kind="linear", evidence="test"),
            glare=glare,
        ),
        shots=shots,
    )


def observation(kind: str) -> Observation:
    if kind == "raw":
        return LinearLight(1.0)
    nodes = np.linspace(-10, 5, 16)
    values = np.stack([1 / (1 + np.exp(-nodes))] * 3)
    values = (values - values[:, :1]) / (values[:, -1:] - values[:, :1])
    return ToneCurve(
        normaliser=1.0,
        nodes=torch.from_numpy(nodes.astype(np.float32)),
        theta=curve_parameters(values)[None],
        of_camera={"cam": 0},
        rate=1.0,
        middle=0.0,
        epsilon=1e-6,
        fixed=0.0,
    )


def an_iteration(kind: str, corrected: tuple[Refined, ...] = (), glare: float = 0.0) -> Counts:
    """The fourth of five iterations: the one before prepares the views, the last would be logged."""
    generator = torch.Generator().manual_seed(0)
    appearance = LuminanceChromaticity()
    view = make_view(kind, glare)
    dataset = Dataset(Path(), view.sensor.kind, (view,), (), None, "")
    gaussians = Gaussians(
        {
            "means": 0.2 * torch.randn(COUNT, 3, generator=generator),
            "log_scales": torch.full((COUNT, 3), -2.0),
            "quats": torch.randn(COUNT, 4, generator=generator),
            "opacity_logits": torch.ones(COUNT),
            **appearance.start(torch.rand(COUNT, 3, generator=generator)),
        }
    )
    counted: list[Counts] = []
    with pretended() as counts:
        method = Method("test", appearance, observation(kind))
        refinement = Refinement.of(dataset, corrected) if corrected else None
        training = Training.begin(method, Light(1.0, 1e-3), gaussians, 1.0, DEVICE, refinement)
        training.iteration = 2  # from here on corrections move
        before = training.gaussians.parameters["means"].detach().cpu().clone()
        train(
            training,
            dataset,
            Plan(5, DensityRules(COUNT, begin=2.0, end=2.0), log_every=100),
            Hooks(steers=[lambda _: counted.append(counts.copy())]),
            until=4,
        )
        assert not torch.equal(training.gaussians.parameters["means"].detach().cpu(), before)
    first, second = counted
    return second - first


OF_ANY = {
    ("copy", "sampling.away_from"): 1,  # the camera's centre
    ("copy", "rasterizer._render"): 1,  # the camera and the limits
    ("wait", "rasterizer._render"): 1,  # how many pairs there are
}
OF_PHOTOGRAPHS = {
    ("copy", "photographs.ToneCurve._expose"): 1,  # exposures
    ("copy", "trainer._background"): 1,  # what stands behind their transparent parts
}
OF_A_VIEW = {
    ("copy", "targets.sent"): 5,  # codes, weights, falloff, alpha and where it counts
}
OF_CORRECTIONS = {
    ("copy", "refinement.Refinement.factors"): 1,  # which exposures
    ("wait", "rasterizer._gradients"): 1,  # the gradient of the camera
}

of_each_kind = pytest.mark.parametrize(
    ("kind", "expected"), [("raw", OF_ANY), ("ldr", OF_ANY | OF_PHOTOGRAPHS)]
)


@of_each_kind
def test_transfers_of_an_iteration(kind: str, expected: dict[tuple[str, str], int]) -> None:
    assert an_iteration(kind) == expected


def test_targets_that_do_not_fit_on_the_device_are_sent_without_waiting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(targets, "room", lambda device: 0)
    assert an_iteration("ldr") == OF_ANY | OF_PHOTOGRAPHS | OF_A_VIEW


@of_each_kind
def test_transfers_with_a_corrected_calibration(kind: str, expected: dict[tuple[str, str], int]) -> None:
    counts = an_iteration(kind, ("poses", "exposures", "vignetting", "glare"))
    assert counts == expected | OF_CORRECTIONS
    assert sum(number for (what, _), number in counts.items() if what == "wait") == 2


def test_transfers_behind_a_lens_whose_glare_is_known() -> None:
    assert an_iteration("raw", glare=0.05) == OF_ANY | {("copy", "glare.scattered"): 1}


def test_ranks_add_what_is_on_the_device_and_what_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gradients of poses are on the CPU, all others on the device, where the ranks' sums are taken."""
    monkeypatch.setattr(ranks, "_device", lambda: DEVICE)
    monkeypatch.setattr(torch.distributed, "all_reduce", lambda flat: flat.mul_(2))
    with pretended():
        there, here = torch.arange(6.0).reshape(2, 3).to(DEVICE), torch.full((2,), 10.0)
        ranks.Ranks(0, 2).add([there, here])
        assert there.device == DEVICE
        assert there.cpu().tolist() == [[0.0, 2.0, 4.0], [6.0, 8.0, 10.0]]
        assert here.tolist() == [20.0, 20.0]


def test_ranks_find_the_largest_of_what_is_not_on_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """A training on the CPU of a machine with GPUs has its statistics there; NCCL takes the GPU's alone."""

    def all_reduce(tensor: torch.Tensor, operation: object) -> None:
        assert (tensor.device, operation) == (DEVICE, torch.distributed.ReduceOp.MAX)
        tensor.clamp_(min=2.0)

    monkeypatch.setattr(ranks, "_device", lambda: DEVICE)
    monkeypatch.setattr(torch.distributed, "all_reduce", all_reduce)
    with pretended():
        there, here = torch.tensor([1.0, 3.0]).to(DEVICE), torch.tensor([4.0, 1.0])
        for tensor in (there, here):
            ranks.Ranks(0, 2).raise_to_largest(tensor)
        assert there.cpu().tolist() == [2.0, 3.0]
        assert here.tolist() == [4.0, 2.0]
