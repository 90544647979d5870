"""`rig doctor`: what this machine has, and what is missing."""

from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import JsonOption
from rig.terminal.outcome import Outcome, running
from rig.terminal.tables import table
from rig.terminal.text import counted

if TYPE_CHECKING:
    from imaging.extreme_case import Extreme

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


def doctor(
    stability: Annotated[
        bool,
        typer.Option(
            "--stability",
            help="Run numerical stress tests on this machine instead, and compare their results with "
            "float64 and the truth.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> Outcome:
    """Check this machine's setup.

    Looks at libusb, permissions, memory for USB transfers, the GPU, and versions; opens no camera.

    Example: rig doctor --stability
    """
    if stability:
        with running("doctor") as meter:
            from rig.stability import extremes

            return told(list(extremes(True, progress=meter)))
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
        lines.append(f"{'!' if one.fix else ' '} {one.name:{width}}  {one.says}")
        if one.fix:
            lines.append(f"  {'':{width}}  {one.fix}")
    wrong = [one for one in findings if one.fix]
    names = ", ".join(one.name for one in wrong)
    lines.append(f"{counted(len(wrong), 'problem')} to fix: {names}." if wrong else "Everything is in order.")
    return Outcome({"findings": [asdict(one) for one in findings], "in_order": not wrong}, lines)


PARTS = ("calibration", "splatting", "methods")
COLUMNS = ("Case", "Worst of", "Against", "Error", "Limit", "OK")


def told(rows: "list[Extreme]") -> Outcome:
    """The extremes as an outcome: all of them as a table, and the failures by name."""
    groups = [(part.capitalize(), [_row(one) for one in rows if one.part == part]) for part in PARTS]
    lines = table(groups, COLUMNS, {"Case": 3, "Worst of": 2})
    wrong = [one for one in rows if not one.ok]
    missing = None
    if wrong:
        worst = "; ".join(f"{one.case}, {one.what}" for one in wrong[:4])
        missing = f"{len(wrong)} of {counted(len(rows), 'result')} are outside their limits: {worst}."
    else:
        lines.append(f"All {len(rows)} results are within their limits.")
    data = {"extremes": [one.record() for one in rows], "in_order": not wrong}
    return Outcome(data, lines, missing, defect=True)


def _row(one: "Extreme") -> tuple[str, ...]:
    error = "not finite" if one.error is None else f"{one.error:.1e}"
    return one.case, one.what, one.against, error, f"{one.limit:.0e}", "yes" if one.ok else "NO"


def _training() -> tuple[str, str, str]:
    """What `rig reconstruct` will run on."""
    import torch

    from recon.train.device import device_name, training_device

    device = training_device()
    if device.type == "cpu" and torch.cuda.is_available():
        return "training", f"on the {device_name(device)}, though there is a GPU", "pip install triton"
    return "training", f"on {device_name(device)}", ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
