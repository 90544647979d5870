"""The comparison of the GPU's kernels with the processor's, interpreted; and trainings where it fails."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

if not torch.cuda.is_available():
    os.environ["TRITON_INTERPRET"] = "1"  # read when Triton is first imported

pytest.importorskip("triton", reason="Triton is for Linux")

from imaging.errors import ReconstructionError
from recon import reconstruct as stage
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.result.model import MODEL
from recon.splat.gpu import rasterizer
from recon.train.devices import gpu_check
from recon.train.devices.gpu_check import GpuCheck, checked, compared, examined, trusted
from recon.train.devices.warm_up import warm_up
from tests.recon.interpreter import quick_interpreter

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
GPU = torch.device("cuda", 0)


@pytest.fixture(autouse=True)
def _interpreted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    if DEVICE.type == "cpu":
        quick_interpreter(monkeypatch)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Spoilt:
    """A kernel that puts a factor on one of its outputs, or raises."""

    def __init__(self, kernel, output: str, factor: float = 1.0, error: Exception | None = None) -> None:
        self.kernel, self.place, self.factor, self.error = kernel, output, factor, error

    def __getitem__(self, grid):
        def launch(*arguments, **options):
            if self.error is not None:
                raise self.error
            self.kernel[grid](*arguments, **options)
            arguments[self.kernel.arg_names.index(self.place)].mul_(self.factor)

        return launch


def small() -> GpuCheck:
    return compared(DEVICE, 6, 12)


def test_both_scenes_agree() -> None:
    check = small()
    assert check.wrong == ""
    assert set(check.errors) == set(gpu_check.LIMITS)
    assert max(check.errors.values()) < 1e-5
    assert min(check.errors.values()) > 0, "nothing was compared"


@pytest.mark.parametrize(
    ("module", "kernel", "output", "what"),
    [
        (rasterizer, "project_backward", "grad_quats", "gradients"),
        (rasterizer, "composite_backward", "slots", "gradients"),
        (rasterizer.sums, "add_slots", "pull", "statistics"),
        (rasterizer, "composite", "image", "image"),
        (rasterizer, "composite", "remaining", "alpha"),
    ],
)
def test_a_kernel_that_is_wrong_by_a_thousandth_is_named(
    module, kernel: str, output: str, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, kernel, Spoilt(getattr(module, kernel), output, 1.001))
    check = small()
    assert f"{what} through Brown's lens differ from the processor's by" in check.wrong
    assert check.errors == {}


def test_a_number_that_is_none_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    spoilt = Spoilt(rasterizer.project_backward, "grad_means", float("nan"))
    monkeypatch.setattr(rasterizer, "project_backward", spoilt)
    assert "gradients through Brown's lens differ from the processor's by nan" in small().wrong


def test_an_error_of_the_compiler_is_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    error = RuntimeError("ptxas: no such target\nand forty lines more")
    monkeypatch.setattr(rasterizer, "composite", Spoilt(rasterizer.composite, "image", error=error))
    assert small().wrong == "its kernels did not run (RuntimeError: ptxas: no such target)"


def test_what_is_right_is_kept_until_something_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    results = [GpuCheck({"image": 1e-7}), GpuCheck({}, "wrong"), GpuCheck({"image": 2e-7})]
    monkeypatch.setattr(gpu_check, "compared", lambda device: results.pop(0))
    assert checked(DEVICE).errors == checked(DEVICE).errors == {"image": 1e-7}
    monkeypatch.setattr(gpu_check, "device_name", lambda device: "another GPU")
    assert checked(DEVICE).wrong == "wrong"
    assert checked(DEVICE).errors == {"image": 2e-7}, "what is wrong is compared again"


def test_an_examination_forgets_what_was_right(monkeypatch: pytest.MonkeyPatch) -> None:
    results = [GpuCheck({"image": 1e-7}), GpuCheck({}, "wrong"), GpuCheck({"image": 2e-7})]
    monkeypatch.setattr(gpu_check, "compared", lambda device: results.pop(0))
    examined(DEVICE)
    assert examined(DEVICE).wrong == "wrong"
    assert checked(DEVICE).errors == {"image": 2e-7}


def test_training_goes_on_on_the_processor(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage, "training_device", lambda: GPU)
    monkeypatch.setattr(gpu_check, "device_name", lambda device: "GeForce")
    monkeypatch.setattr(gpu_check, "compared", lambda device: GpuCheck({}, "gradients differ"))
    said: list[str] = []
    overrides = Overrides(iterations=2, gaussians=60, width=32, refine="none", environment=False)
    request = TrainingRequest(quality="draft", overrides=overrides, name="checked", replace=True)
    folder = stage.reconstruct(toy, request, on_message=said.append)
    assert (
        "GeForce is not used, since gradients differ: the training runs on the processor; update the GPU's "
        "driver and torch, then check with rig doctor."
    ) in said
    assert "CPU" in json.loads((folder / MODEL).read_text())["device"]


def test_several_processes_train_on_devices_of_one_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_check, "device_name", lambda device: "GeForce")
    monkeypatch.setattr(gpu_check, "compared", lambda device: GpuCheck({}, "gradients differ"))
    with pytest.raises(ReconstructionError, match="GeForce cannot train with others, since gradients differ"):
        trusted(GPU, print, alone=False)


def test_warming_up_does_not_use_kernels_that_are_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_check, "device_name", lambda device: "GeForce")
    monkeypatch.setattr(gpu_check, "compared", lambda device: GpuCheck({}, "gradients differ"))
    said: list[tuple[str, int, int]] = []
    warm_up(lambda *line: said.append(line), GPU)
    assert said[-1] == ("kernels are ready", 4, 4)
