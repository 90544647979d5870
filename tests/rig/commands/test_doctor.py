"""`rig doctor --camera`: the examination of one camera as people and programs see it."""

import json
from pathlib import Path

import pytest
import torch

from drivers import conformance, discovery
from drivers.camera import Camera
from drivers.conformance import EXAMINATIONS
from drivers.errors import CameraTimeout
from recon.train.devices import gpu_check, training_device

from .refusals import assert_refused

NAMES = [ask.__name__ for ask in EXAMINATIONS]


def test_a_camera_is_examined_and_the_report_can_be_sent(rig) -> None:
    code, out, _ = rig("doctor", "--camera", "SIM-RAW-001", "--sim", "toy", "--json")
    report = json.loads(out)
    assert code == 0
    assert report["in_order"]
    assert report["camera"]["serial"] == "SIM-RAW-001"
    assert [(one["name"], one["verdict"]) for one in report["examinations"]] == [
        (name, "passed") for name in NAMES
    ]
    assert report["versions"]["hdr-rig"]


def test_what_fails_is_named(rig) -> None:
    code, out, err = rig("doctor", "--camera", "SIM-LDR-001", "--sim", "toy-ldr")
    assert code != 0
    assert "failed  frames" in out
    assert "skipped light" in out
    assert f"1 examination of {len(NAMES)} failed: frames." in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--camera", "4711", "--sim", "toy"], "(SIM-RAW-001, SIM-RAW-002 found)"),
        (["--sim", "toy"], "--sim needs --camera"),
        (["--camera", "4711", "--stability"], "separate examinations"),
        (["--camera", "4711", "--sim", "none"], "none"),
    ],
)
def test_what_cannot_be_examined(rig, arguments: list[str], says: str, tmp_path: Path) -> None:
    assert says in assert_refused(rig, ["doctor", *arguments], tmp_path)


def test_a_camera_that_does_not_answer_stops_no_examination_of_another(
    rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    find, examined = discovery.find_cameras, []

    def silent() -> None:
        raise CameraTimeout("cam0 does not answer: switch it on.")

    def find_cameras(*given: object) -> list[Camera]:
        first, *others = find(*given)
        monkeypatch.setattr(first, "identify", silent)
        return [first, *others]

    def examine(camera: Camera, *given: object, **more: object) -> list[conformance.Examination]:
        examined.append(camera.identify().serial)
        return [conformance.Examination("identity", "passed", "")]

    monkeypatch.setattr(discovery, "find_cameras", find_cameras)
    monkeypatch.setattr(conformance, "examine", examine)
    assert rig("doctor", "--camera", "SIM-RAW-002", "--sim", "toy")[0] == 0
    code, _, err = rig("doctor", "--camera", "SIM-RAW-001", "--sim", "toy")
    assert (code, err) == (2, "cam0 does not answer: switch it on.\n")
    assert examined == ["SIM-RAW-002"]


@pytest.mark.parametrize(
    ("result", "says"),
    [
        (gpu_check.GpuCheck({"image": 1.6e-7, "gradients": 9.9e-7}), "image 1.6e-07, gradients 9.9e-07"),
        (
            gpu_check.GpuCheck({}, "its kernels did not run (KeyError: maxnreg)"),
            "not on GeForce: its kernels",
        ),
    ],
)
def test_the_kernels_of_a_gpu_are_examined(
    rig, result: gpu_check.GpuCheck, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training_device, "training_device", lambda: torch.device("cuda", 0))
    monkeypatch.setattr(training_device, "device_name", lambda which: "GeForce")
    monkeypatch.setattr(gpu_check, "examined", lambda which: result)
    _, out, _ = rig("doctor", "--json")
    (finding,) = (one for one in json.loads(out)["findings"] if one["name"] == "training")
    assert says in finding["says"]
    assert bool(finding["fix"]) == bool(result.wrong)
