"""`rig doctor`: what this machine has, and what is missing."""

from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated

import typer

from capture.rigfile import network_address
from drivers import conformance, discovery, host
from imaging import stress_case
from imaging.errors import CameraError, InputError
from recon.train.devices import gpu_check
from recon.train.devices import training_device as devices
from rig import stability as stresses
from rig.cameras import usb_bus
from rig.options.camera_addresses import addresses_of
from rig.options.common import JsonOption
from rig.options.defaults import NAMED_BY, config_file, read_defaults, usual_place
from rig.terminal import progress
from rig.terminal.result import CommandResult, running
from rig.terminal.tables import table
from rig.terminal.text import counted

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
    context: typer.Context,
    camera: Annotated[
        str | None,
        typer.Option(
            "--camera",
            metavar="SERIAL|[gphoto2:]ptpip:ADDRESS|gige:ADDRESS",
            help="Examine this connected camera and its driver instead, with some 50 frames: its states, "
            "exposures, timing and noise. With --json, a report to send.",
        ),
    ] = None,
    sim: Annotated[
        str | None,
        typer.Option("--sim", metavar="NAME", help="With --camera: use the cameras of a simulated rig."),
    ] = None,
    stability: Annotated[
        bool,
        typer.Option(
            "--stability",
            help="Run numerical stress tests on this machine instead, and compare their results with "
            "float64 and the truth.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> CommandResult:
    """Check this machine's setup.

    Checks libusb, permissions, memory for USB transfers, the GPU, your file of defaults and versions; opens
    no camera unless --camera names one.

    Example: rig doctor --camera 4711 --json > report.json
    """
    if camera is not None:
        if stability:
            raise InputError("--camera and --stability are separate examinations: give only one of them.")
        with running("doctor") as status:
            return _camera_result(camera, sim, status)
    if sim is not None:
        raise InputError("--sim needs --camera: name one of its cameras, as rig cameras --sim lists them.")
    if stability:
        with running("doctor") as status:
            return _stability_result(list(stresses.extremes(True, progress=status)))
    with running("doctor") as status:
        status("looking for cameras", 0, 2)
        findings = host.examine()
        status("looking for a GPU", 1, 2)
        findings.append(host.Finding(*_training(status)))
    findings.append(host.Finding(*_defaults(context)))
    findings += [host.Finding(name, _version(name)) for name in PACKAGES]
    width = max(len(finding.name) for finding in findings)
    lines = []
    for finding in findings:
        lines.append(f"{'!' if finding.fix else ' '} {finding.name:{width}}  {finding.says}")
        if finding.fix:
            lines.append(f"  {'':{width}}  {finding.fix}")
    wrong = [finding for finding in findings if finding.fix]
    names = ", ".join(finding.name for finding in wrong)
    lines.append(f"{counted(len(wrong), 'problem')} to fix: {names}." if wrong else "Everything is in order.")
    return CommandResult(
        {"findings": [asdict(finding) for finding in findings], "in_order": not wrong}, lines
    )


def _camera_result(which: str, sim: str | None, status: "progress.StatusLine") -> CommandResult:
    """Result of a camera's examination, a line each."""
    named = addresses_of([which], sim) if which.startswith(("gige:", "ptpip:", "gphoto2:")) else []
    bus = usb_bus.open_bus(sim)
    cameras = discovery.find_cameras(
        bus.backend, bus.clock, usb_bus.open_network(sim, named), network_address.ptpip_places(named)
    )
    status("looking for cameras", 0, 0)
    silent: list[CameraError] = []
    try:
        if named:
            there = [camera for camera in cameras if camera.where == named[0].where]
            by_serial = dict(zip([which], there, strict=False))
        else:
            by_serial = {}
            for camera in cameras:
                try:
                    by_serial[camera.identify().serial] = camera
                except CameraError as error:  # of another camera, as far as is known
                    silent.append(error)
        if which not in by_serial:
            if silent:  # any of them may be the one
                raise silent[0]
            known = ", ".join(sorted(by_serial)) or "none"
            what = "" if named else " with the serial number"
            raise InputError(f"No camera{what} {which!r} is connected ({known} found).")
        identity, verified = by_serial[which].identify(), by_serial[which].verified()
        rows = list(conformance.examine(by_serial[which], bus.clock, on_progress=status))
    finally:
        for camera in cameras:
            camera.close()
    width = max(len(row.name) for row in rows)
    about = f"{identity.make} {identity.model}, serial number {identity.serial}"
    lines = [f"{about}; driver verified against: {verified}"]
    lines += [f"{row.verdict:8}{row.name:{width}}  {row.says}" for row in rows]
    failed = [row.name for row in rows if row.verdict == "failed"]
    skipped = [row.name for row in rows if row.verdict == "skipped"]
    missing = None
    if failed:
        missing = f"{counted(len(failed), 'examination')} of {len(rows)} failed: {', '.join(failed)}."
    else:
        rest = f", but for {', '.join(skipped)}, which could not be examined" if skipped else ""
        lines.append(f"The camera does what rig needs{rest}.")
    data = {
        "camera": asdict(identity),
        "verified": verified,
        "examinations": [asdict(row) for row in rows],
        "versions": {name: _version(name) for name in PACKAGES},
        "in_order": not failed,
    }
    return CommandResult(data, lines, missing)


PARTS = ("calibration", "splatting", "methods")
COLUMNS = ("Case", "Worst of", "Against", "Error", "Limit", "OK")


def _stability_result(rows: "list[stress_case.StressCase]") -> CommandResult:
    """Result of the stress tests: all of them as a table, and the failures by name."""
    groups = [(part.capitalize(), [_row(case) for case in rows if case.part == part]) for part in PARTS]
    lines = table(groups, COLUMNS, {"Case": 3, "Worst of": 2})
    wrong = [case for case in rows if not case.ok]
    missing = None
    if wrong:
        worst = "; ".join(f"{case.case}, {case.what}" for case in wrong[:4])
        missing = f"{len(wrong)} of {counted(len(rows), 'result')} are outside their limits: {worst}."
    else:
        lines.append(f"All {len(rows)} results are within their limits.")
    data = {"extremes": [case.record() for case in rows], "in_order": not wrong}
    return CommandResult(data, lines, missing, defect=True)


def _row(case: "stress_case.StressCase") -> tuple[str, ...]:
    error = "not finite" if case.error is None else f"{case.error:.1e}"
    return case.case, case.what, case.against, error, f"{case.limit:.0e}", "yes" if case.ok else "NO"


def _training(status: "progress.StatusLine") -> tuple[str, str, str]:
    """Environment of `rig reconstruct`; the kernels of a GPU are compared with the processor's."""
    import torch

    device = devices.training_device()
    if device.type == "cpu" and torch.cuda.is_available():
        return (
            "training",
            f"on the {devices.device_name(device)}, though there is a GPU",
            "pip install triton",
        )
    name = devices.device_name(device)
    if device.type == "cpu":
        return "training", f"on {name}", ""
    status(f"checking the kernels of {name}", 1, 2)
    check = gpu_check.examined(device)
    if check.wrong:
        fix = "Update the GPU's driver and torch; until then training runs on the processor."
        return "training", f"not on {name}: {check.wrong}", fix
    return "training", f"on {name}; {check.in_words()}", ""


def _defaults(context: typer.Context) -> tuple[str, str, str]:
    """The file that says what options are if they are not given."""
    path = config_file()
    if path is None:
        return "defaults", f"rig's own: no {usual_place()}, and {NAMED_BY} names no file", ""
    try:
        read_defaults(path, context.find_root().command)
    except InputError as error:
        return "defaults", f"{path} cannot be used", str(error)
    return "defaults", f"those of {path}, then rig's own", ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
