"""`rig simulate`: it says where it is, serves, and ends with Ctrl-C."""

import json
import re
import signal
import socket
import struct
import subprocess
import sys

import pytest

from drivers import ptp, u3v
from drivers.clock import SystemClock
from imaging.optics.exposure import Exposure
from rig.terminal.progress import PlainStatusLine
from tests.drivers.gige.fakes import camera_at, only_at, own_address
from tests.drivers.gige.test_sim_device import shoot
from tests.drivers.sim.usb.usbip.attached import AttachedBus


def test_it_says_where_it_is_serves_and_ends_with_ctrl_c() -> None:
    command = [sys.executable, "-m", "rig", "simulate", "--ptpip", "127.0.0.1:0", "--profile", "nikon-z6"]
    with subprocess.Popen(
        [*command, "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        line = next(line for line in process.stderr if "ptpip:" in line)
        matched = re.search(r"Z 6 is at 127\.0\.0\.1:(\d+), try: .* ptpip:127\.0\.0\.1:\1:\1", line)
        assert matched, line
        port = int(matched[1])
        with socket.create_connection(("127.0.0.1", port), timeout=30.0) as link:
            link.sendall(struct.pack("<II", 8 + 22, 1) + bytes(22))
            assert struct.unpack("<II", link.recv(8))[1] == 2
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60.0)
    assert process.returncode == 0
    assert json.loads(out) == {
        "command": "simulate",
        "exit_code": 0,
        "profile": "nikon-z6",
        "serial": f"SIM-NIKON-Z6-{port}",
        "host": "127.0.0.1",
        "port": port,
        "shots": 0,
    }


def test_ctrl_c_ends_it_well_as_soon_as_it_says_where_it_is(rig, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(line: PlainStatusLine, said: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(PlainStatusLine, "say", interrupted)
    code, out, err = rig("simulate", "--ptpip", "127.0.0.1:0")
    assert (code, err) == (0, "")
    assert out == "Simulated PTP took 0 shots\n"


@pytest.mark.parametrize("text", ["15740", "127.0.0.1", "127.0.0.1:70000", "a b:1"])
def test_an_address_that_is_none_is_wrong_usage(rig, text: str) -> None:
    code, out, err = rig("simulate", "--ptpip", text)
    assert (code, out) == (2, "")
    assert "write an address as 127.0.0.1:15740" in err


@pytest.mark.parametrize("option", ["--ptpip", "--usbip"])
def test_an_unknown_profile_lists_those_there_are(rig, option: str) -> None:
    code, _, err = rig("simulate", option, "127.0.0.1:0", "--profile", "leica")
    assert code == 2
    assert "generic, canon-eos-6d, canon-eos-r7, nikon-z6, sony-a7m4" in err


@pytest.mark.parametrize("option", ["--ptpip", "--usbip"])
def test_an_address_that_is_taken_is_told_before_anything_is_rendered(
    rig, monkeypatch: pytest.MonkeyPatch, option: str
) -> None:
    monkeypatch.setattr("drivers.sim.rigs.simulate", lambda *asked: pytest.fail("it was rendered"))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        code, _, err = rig("simulate", option, f"127.0.0.1:{port}")
    assert code == 2
    assert (
        f"127.0.0.1:{port} cannot be opened for listening (Address already in use): choose another one."
        in err
    )


def test_it_is_a_gige_camera_at_an_address_of_this_host() -> None:
    address = own_address(30)
    command = [sys.executable, "-m", "rig", "simulate", "--gige", address, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = next(line for line in process.stderr if "gige:" in line)
        (discovered,) = only_at(address).discover()
        assert discovered.serial in line
        assert f"rig cameras --camera gige:{address}" in line
        camera = camera_at(address)
        assert shoot(camera).pixels.ndim == 2
        camera.close()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60.0)
    assert process.returncode == 0
    told_at_end = json.loads(out)
    assert (told_at_end["gige"], told_at_end["shots"]) == (address, 1)


@pytest.mark.parametrize(
    ("profile", "kind"), [((), "ef/05/00"), (("--profile", "nikon-z6"), "06/01/01")], ids=["vision", "still"]
)
def test_it_is_a_camera_on_the_usb_of_who_attaches_it(profile: tuple[str, ...], kind: str) -> None:
    command = [sys.executable, "-m", "rig", "simulate", "--usbip", "127.0.0.1:0", *profile, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = next(line for line in process.stderr if "usbip" in line)
        matched = re.search(
            r"(SIM-7f000001-(\d+)) is at 127\.0\.0\.1:\2, try as root: modprobe vhci-hcd && "
            r"usbip --tcp-port \2 attach -r 127\.0\.0\.1 -b (\S+)\n",
            line,
        )
        assert matched, line
        serial, port, bus_id = matched.groups()
        attached = AttachedBus(("127.0.0.1", int(port)))
        (device,) = attached.devices
        interface = device.interfaces[0][0]
        code = (interface.bInterfaceClass, interface.bInterfaceSubClass, interface.bInterfaceProtocol)
        assert "/".join(f"{one:02x}" for one in code) == kind
        driver = ptp if profile else u3v
        (camera,) = driver.find_cameras(attached, SystemClock())
        assert camera.identify().serial == serial
        camera.set_exposure(Exposure(time=1 / 60, iso=200))
        camera.arm()
        camera.trigger()
        assert camera.collect().metadata.serial == serial
        camera.close()
        attached.detach()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60.0)
    assert process.returncode == 0
    data = json.loads(out)
    assert (data["usbip"], data["serial"], data["shots"]) == (bus_id, serial, 1)


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("--gige", "127.0.0.1", "--ptpip", "127.0.0.1:0"),
        ("--usbip", "127.0.0.1:0", "--ptpip", "127.0.0.1:0"),
    ],
)
def test_it_is_one_camera_of_one_kind(rig, words: tuple[str, ...]) -> None:
    code, _, err = rig("simulate", *words)
    assert code == 2
    assert "give --ptpip HOST:PORT, --gige IPV4 or --usbip HOST:PORT, one of them" in err


def test_a_profile_is_for_still_cameras(rig) -> None:
    code, _, err = rig("simulate", "--gige", "127.0.0.1", "--profile", "nikon-z6")
    assert code == 2
    assert "--profile is for --ptpip and --usbip" in err


def test_an_address_that_is_not_this_hosts_is_told(rig) -> None:
    code, _, err = rig("simulate", "--gige", "203.0.113.7")
    assert code == 2
    assert "203.0.113.7 cannot be listened on at port 3956" in err
