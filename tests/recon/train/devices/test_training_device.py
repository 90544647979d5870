"""Everything between the Gaussians and the gradient stays on one device.

Torch's `meta` device holds shapes and no values: a tensor that was left on the CPU meets it in an error,
and so does a value that is read back, which on a GPU would wait for all that is under way.
"""

from pathlib import Path

import pytest
import torch

from recon.data.load import load
from recon.scene.appearance import LuminanceChromaticity, PlainHarmonics
from recon.train.devices.training_device import device_name, gpus, training_device
from recon.train.training import Training
from tests.recon.beginning import beginning

META = torch.device("meta")


def begun(session: Path, name: str) -> tuple[Training, object]:
    dataset = load(session)
    return beginning(dataset, 100)(name, device=META), dataset.train[0]


@pytest.mark.parametrize(
    ("session", "name"),
    [("toy", "nh-3dgs"), ("toy", "vanilla"), ("toy_ldr", "hdr-gs"), ("toy_ldr", "vanilla")],
)
def test_observation_and_loss_stay_there(session: str, name: str, request: pytest.FixtureRequest) -> None:
    training, view = begun(request.getfixturevalue(session), name)
    method = training.method
    image = torch.empty(view.lens.height, view.lens.width, 3, device=META, requires_grad=True)
    prediction, target = method.observation.compare(image, view, 0.9)
    assert prediction.device == target.device == META
    loss = method.loss(prediction, target) + method.appearance.penalty(training.gaussians.parameters)
    (loss + method.observation.penalty(0.9)).backward()
    assert image.grad is not None
    assert image.grad.device == META
    assert method.observation.predict(image, view, 1.0).device == META


@pytest.mark.parametrize("appearance", [LuminanceChromaticity(), PlainHarmonics()])
def test_colours_stay_there(appearance: LuminanceChromaticity) -> None:
    start = appearance.start(torch.rand(7, 3, generator=torch.Generator().manual_seed(0)))
    parameters = {name: value.to(META).requires_grad_() for name, value in start.items()}
    directions = torch.empty(7, 3, device=META)
    for degree in range(3):
        colours = appearance.colours(parameters, directions, degree)
        assert colours.device == META
        (colours.sum() + appearance.penalty(parameters)).backward()
        assert appearance.luminance(parameters).device == META


def test_the_device_of_this_machine_has_a_name() -> None:
    device = training_device()
    assert device.type == ("cuda" if torch.cuda.is_available() else "cpu")
    assert device_name(device)
    assert "CPU" in device_name(torch.device("cpu"))


def test_each_gpu_is_named_as_a_process_is_given_it_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "recon.train.devices.training_device.training_device", lambda: torch.device("cuda", 0)
    )
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    assert gpus() == ["0", "1"]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,GPU-ab")
    assert gpus() == ["3", "GPU-ab"]
    monkeypatch.setattr("recon.train.devices.training_device.training_device", lambda: torch.device("cpu"))
    assert gpus() == []
