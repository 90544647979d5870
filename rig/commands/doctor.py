"""`rig doctor`: what this machine lacks."""

from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version

from rig.commands.options import JsonOption
from rig.running import Outcome, running

PACKAGES = (
    "hdr-rig",
    "torch",
    "numba",
    "pycolmap",
    "rawpy",
    "OpenEXR",
    "opencv-contrib-python-headless",
    "pyusb",
)


def doctor(as_json: JsonOption = False) -> Outcome:
    """Look at what this machine has for cameras and for training, and say what to mend.

    Looks at libusb, permissions, memory for USB transfers, the GPU, and versions; opens no camera.

    Example: rig doctor
    """
    with running("doctor") as meter:
        from drivers.host import Finding, examine

        meter("looking for cameras", 0, 2)
        findings = examine()
        meter("looking for a GPU", 1, 2)
        findings.append(Finding(*_training()))
    findings += [Finding(name, _version(name)) for name in PACKAGES]
    width = max(len(one.name) for one in findings)
    lines = []
    for one in findings:
        lines.append(f"{'!' if one.mend else ' '} {one.name:{width}}  {one.says}")
        if one.mend:
            lines.append(f"  {'':{width}}  {one.mend}")
    wrong = [one for one in findings if one.mend]
    lines.append(
        "Everything is in order." if not wrong else f"To mend: {', '.join(one.name for one in wrong)}."
    )
    return Outcome({"findings": [asdict(one) for one in findings], "in_order": not wrong}, lines)


def _training() -> tuple[str, str, str]:
    """What `rig reconstruct` will run on."""
    import torch

    from recon.device import device_name, training_device

    device = training_device()
    if device.type == "cpu" and torch.cuda.is_available():
        return "training", f"on the {device_name(device)}, though there is a GPU", "pip install triton"
    return "training", f"on {device_name(device)}", ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
