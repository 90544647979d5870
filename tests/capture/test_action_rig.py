"""`mode = "action"` in RIG.toml: cameras on the network that one command triggers, from file to shots."""

from pathlib import Path

import pytest

from capture.capture_rig import capture_rig
from capture.rigfile.network_address import NetworkAddress, gige_hosts
from capture.rigfile.rigfile import read_rig_file
from capture.rigfile.template import rig_file_text
from drivers.clock import SystemClock
from drivers.discovery import ask_all
from drivers.gige import Network
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import InputError
from imaging.session.session import Session
from tests.drivers.gige.rows import rows

SKEWS = (0.0, 2e-3, 0.5e-3)
NO_USB = VirtualBus(VirtualClock())


def rig_file(path: Path, network: Network, addresses: tuple[str, ...]) -> Path:
    """File of rig init, with the trigger changed, and an exposure that needs no meter."""
    listed = list(ask_all(NO_USB, SystemClock(), network=network))
    text = rig_file_text(listed, addresses=[NetworkAddress("gige", address) for address in addresses])
    for address in addresses:
        assert f'address = "gige:{address}"' in text
    path.write_text(text.replace('mode = "software"', 'mode = "action"').replace("# time = ", "time = "))
    return path


@pytest.mark.parametrize("synchronised", [True, False])
def test_a_bracket_of_three_cameras_is_shot_by_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, synchronised: bool
) -> None:
    if not synchronised:
        monkeypatch.setattr("capture.connected_rig.AGREEMENT", 0.0)
    said: list[str] = []
    with rows() as make:
        row = make(3, skews=SKEWS, synchronised=synchronised)
        addresses = tuple(device.address for device in row.devices)
        network = Network(addresses, [])
        rig = read_rig_file(rig_file(tmp_path / "RIG.toml", network, addresses))
        assert (tuple(gige_hosts(rig.tables.addresses)), rig.tables.leader) == (addresses, "cam0")
        result = capture_rig(
            rig,
            tmp_path / "S",
            bracket=(-1.0, 0.0, 1.0),
            backend=NO_USB,
            network=network,
            clock=SystemClock(),
            on_message=said.append,
        )
        truth = [[device.opened[number] for device in row.devices] for number in range(3)]
    assert (result.planned, result.taken, result.missing) == (9, 9, ())
    if not synchronised:
        assert said[-1].startswith("No common time (IEEE 1588) with cam0, cam1, cam2: ")
        return
    assert said == []
    shots = Session.open(tmp_path / "S").shots()
    for number, moments in enumerate(truth):
        skews = {shot.camera: shot.skew for shot in shots if shot.step == number}
        assert [skews[f"cam{index}"] for index in range(3)] == pytest.approx(
            [moment - min(moments) for moment in moments], abs=10e-6
        )


def test_a_camera_on_no_network_is_refused_by_name(tmp_path: Path) -> None:
    bus = BusRig(simulate("toy", seed=5, samples=1))
    path = tmp_path / "RIG.toml"
    text = rig_file_text(list(ask_all(bus.backend, bus.clock)))
    path.write_text(text.replace('mode = "software"', 'mode = "action"'))
    with pytest.raises(
        InputError, match=r"line \d+: cam0 is no GigE Vision camera .* set mode = \"software\""
    ):
        capture_rig(read_rig_file(path), tmp_path / "S", backend=bus.backend, clock=bus.clock)
