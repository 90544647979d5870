"""`rig init`, and `rig capture` with a rig file: on simulated buses, with and without a person at the rig."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from capture.record.session_plan import asked_for
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from drivers.sim.usb.bus import Holder, VirtualBus
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import InputError
from rig.cameras.usb_bus import UsbBus
from rig.terminal.operator import TerminalOperator
from rig.terminal.result import CommandResult


def json_of(rig, *arguments: str) -> dict:
    code, out, err = rig(*arguments, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


@dataclass
class Terminal:
    """A standard input at which somebody presses Enter."""

    pressed: int = 0
    is_there: bool = True

    def isatty(self) -> bool:
        return self.is_there

    def readline(self) -> str:
        self.pressed += 1
        return "\n"


@dataclass
class Cameras:
    """The toy rig's cameras as real ones: nobody but a person moves anything. A bus of its own each time."""

    seed: int = 0
    held: str | None = None
    clocks: list[VirtualClock] = field(default_factory=list)

    def __call__(self, sim: str | None, seed: int = 0, *, rough: bool = False) -> UsbBus:
        bus = BusRig(simulate("toy", self.seed, samples=1))
        if self.held is not None:
            bus.backend.hold(self.held, Holder.OTHER_PROGRAM)
        self.clocks.append(bus.clock)
        return UsbBus(bus.backend, bus.clock)


@pytest.fixture
def cameras(monkeypatch: pytest.MonkeyPatch) -> Cameras:
    """Two cameras are connected to this machine."""
    there = Cameras()
    monkeypatch.setattr("rig.cameras.usb_bus.open_bus", there)
    return there


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Somebody sits before it."""
    there = Terminal()
    monkeypatch.setattr("sys.stdin", there)
    return there


@pytest.fixture
def file(rig, tmp_path: Path) -> Path:
    """The rig file of the simulated toy rig, with a middle exposure that needs no status."""
    path = tmp_path / "RIG.toml"
    assert rig("init", str(path), "--sim", "toy")[0] == 0
    path.write_text(path.read_text().replace("# time = ", "time = "))
    return path


def test_a_rig_file_is_written_once(rig, tmp_path: Path) -> None:
    path = tmp_path / "new" / "RIG.toml"
    assert json_of(rig, "init", str(path), "--sim", "toy")["cameras"] == ["SIM-RAW-001", "SIM-RAW-002"]
    before = path.read_bytes()
    code, out, err = rig("init", str(path), "--sim", "demo")
    assert (code, out) == (2, "")
    assert f"{path} exists already" in err
    assert path.read_bytes() == before


def test_no_camera_leaves_no_file_and_one_that_is_held_is_missing(
    rig, tmp_path: Path, cameras: Cameras, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "RIG.toml"
    cameras.held = "SIM-RAW-002"
    code, out, err = rig("init", str(path))
    assert code == 3
    assert "1 camera left out: USB" in err
    assert "held by another program" in err
    assert path.read_text().count("\n[[camera]]") == 1
    assert f"{path}: 1 camera\n" in out
    clock = VirtualClock()
    monkeypatch.setattr("rig.cameras.usb_bus.open_bus", lambda sim: UsbBus(VirtualBus(clock), clock))
    code, out, err = rig("init", str(tmp_path / "other.toml"))
    assert (code, out) == (2, "")
    assert err == "no camera is connected: connect the rig; rig doctor shows what is missing.\n"
    assert [one.name for one in tmp_path.iterdir()] == ["RIG.toml"]


def test_a_rig_file_is_shot_with_and_the_command_line_goes_before_it(rig, file: Path, tmp_path: Path) -> None:
    capture = ("capture", str(file), str(tmp_path / "S"), "--sim", "toy", "--slowest", "1/8")
    planned = json_of(rig, *capture, "--dry-run")
    assert json_of(rig, *capture)["taken"] == planned["shots"]
    plan = json.loads((tmp_path / "S" / "plans.jsonl").read_text())
    assert (plan["asked"], plan["frames"]) == ("auto, snr 20, slowest 0.125", [0])
    assert json_of(rig, *capture, "--resume")["earlier"] == planned["shots"]
    code, _, err = rig(*capture[:-2], "--snr", "30", "--resume")
    assert code == 2
    assert "was planned with the bracket auto, snr 20, slowest 0.125 (" in err
    assert "a new folder for auto, snr 30" in err


def test_frames_for_the_calibration_are_announced_by_a_dry_run(rig, tmp_path: Path) -> None:
    out = str(tmp_path / "S")
    assert rig("capture", "--sim", "toy", out, "--frames", "1")[0] == 0
    code, text, _ = rig("capture", "--sim", "toy", out, "--darks", "--frames", "2", "--dry-run")
    assert code == 0
    assert text.startswith("2 cameras, 2 repeats, 3 exposures each (1/1000 s f/4 ISO 100, ")
    assert json_of(rig, "capture", "--sim", "toy", out, "--darks", "--frames", "2")["planned"] == 12


def test_a_shoot_is_forecast_by_view_and_in_all_and_held_against_what_it_came_to(rig, tmp_path: Path) -> None:
    shoot = ("capture", "--sim", "toy", str(tmp_path / "S"), "--frames", "2")
    forecast = json_of(rig, *shoot, "--dry-run")["forecast"]
    run = json_of(rig, *shoot)["run"]
    assert 0.9 < forecast["seconds"] / run["seconds"] < 1.1
    assert forecast["bytes"] == run["bytes"] == 2 * sum(forecast["bytes_per_view"].values())
    assert forecast["fits"]
    assert json.loads((tmp_path / "S" / "runs.jsonl").read_text()) == {**run, "basis": run["basis"]}
    code, out, _ = rig(*shoot[:3], str(tmp_path / "T"), *shoot[4:], "--dry-run")
    assert code == 0
    assert "Forecast for 12 shots (test shots): " in out
    assert "  cam0, cam1: 3 exposures of 7.16 kB, 21.5 kB a view" in out
    assert "Focus stays as the lenses are set" in out
    code, out, err = rig(*shoot[:3], str(tmp_path / "T"), *shoot[4:])
    assert code == 0
    assert "Forecast for 12 shots (assumed: 1 s beyond each exposure): " in err
    assert "12 shots took " in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--darks", "--flats"], "give one"),
        (["--darks", "--bracket", "auto"], "an automatic bracket, and its limits, are for scenes"),
        (["--board", "--slowest", "1/8"], "an automatic bracket, and its limits, are for scenes"),
        (["--rough"], "--seed and --rough are for simulated rigs"),
        (["third"], "unexpected extra argument (third)"),
        (["--bracket", "0,3", "--snr", "30"], "explicit stops are not planned"),
    ],
)
def test_what_does_not_go_together_is_told(rig, file: Path, tmp_path: Path, arguments, words: str) -> None:
    code, out, err = rig("capture", str(file), str(tmp_path / "S"), *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err
    assert not (tmp_path / "S").exists()


@pytest.mark.parametrize(
    ("defaults", "arguments", "asked"),
    [
        ('bracket = "auto"', [], "auto, snr 20"),
        ('bracket = "auto"\nsnr = 25', [], "auto, snr 25"),
        ('bracket = "auto"\nsnr = 25', ["--snr", "15"], "auto, snr 15"),
        ('bracket = "auto"\nsnr = 25', ["--bracket=-2,0"], "stops -2, 0"),
        ('bracket = "-2,0"\nsnr = 25', [], "stops -2, 0"),
        ('bracket = "-2,0"', ["--bracket", "auto", "--snr", "15"], "auto, snr 15"),
        ("snr = 25", ["--bracket", "auto"], "auto, snr 25"),
        ("snr = 25", ["--bracket", "0"], "stops 0"),
        ('bracket = "auto"', ["--darks"], None),
        ('bracket = "-2,0"', ["--board"], None),
        ("snr = 25", ["--flats"], None),
    ],
)
def test_defaults_of_the_user_give_way_where_they_do_not_apply(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, defaults: str, arguments, asked: str | None
) -> None:
    shot = list[str | None]()

    def run_capture(sim, out, status, request, **more) -> CommandResult:
        shot.append(None if request.bracket is None else asked_for(request.bracket))
        return CommandResult({}, [])

    monkeypatch.setattr("rig.commands.capture.run_capture", run_capture)
    (tmp_path / "config.toml").write_text(f"[capture]\n{defaults}\n")
    monkeypatch.setenv("RIG_CONFIG", str(tmp_path / "config.toml"))
    code, _, err = rig("capture", "--sim", "toy", str(tmp_path / "S"), *arguments)
    assert (code, err, shot) == (0, "", [asked])


def test_a_capture_with_a_typed_bracket_is_resumed_whatever_the_users_is(
    rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = ("capture", "--sim", "toy", str(tmp_path / "S"))
    assert rig(*capture, "--frames", "1", "--bracket", "0")[0] == 0
    (tmp_path / "config.toml").write_text('[capture]\nbracket = "-2,0,2"\nslowest = "1/4"\n')
    monkeypatch.setenv("RIG_CONFIG", str(tmp_path / "config.toml"))
    code, out, err = rig(*capture, "--resume")
    assert (code, err) == (0, "")
    assert "2 of 2 shots" in out
    code, _, err = rig(*capture, "--resume", "--bracket", "-2,0,2")
    assert (code, "was planned with the bracket stops 0" in err) == (2, True)


def test_a_default_seed_hinders_no_cameras_and_typed_limits_are_still_looked_at(
    rig, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.commands.capture.run_capture", lambda *given, **more: CommandResult({}, []))
    (tmp_path / "config.toml").write_text('[capture]\nseed = 3\nbracket = "-2,0"\n')
    monkeypatch.setenv("RIG_CONFIG", str(tmp_path / "config.toml"))
    capture = ("capture", str(file), str(tmp_path / "S"))
    assert rig(*capture)[0] == 0
    code, _, err = rig(*capture, "--snr", "30", "--sim", "toy", "--darks")
    assert (code, "its limits, are for scenes" in err) == (2, True)
    code, _, err = rig(*capture[:1], *capture[2:], "--sim", "toy", "--snr", "30")
    assert (code, "--snr only limits a bracket that is planned" in err) == (2, True)


def test_a_rig_file_alone_lacks_the_folder(rig, file: Path) -> None:
    code, _, err = rig("capture", str(file))
    assert code == 2
    assert "missing argument 'OUT'" in err


def test_a_person_is_told_what_to_do_and_waited_for(
    rig, file: Path, tmp_path: Path, cameras: Cameras, terminal: Terminal
) -> None:
    capture = ["capture", str(file), str(tmp_path / "S"), "--bracket", "0", "--frames", "3"]
    code, _, err = rig(*capture)
    assert (code, terminal.pressed) == (0, 2)
    forecast, *asked = err.splitlines()
    assert forecast.startswith("Forecast for 6 shots (assumed: 1 s beyond each exposure): ")
    assert ", beside the time in which you move things; " in forecast
    assert asked == [f"Frame {n}: move the rig, or what it looks at. Then press Enter." for n in (1, 2)]
    for kind, pressed, words in (
        ("--darks", 1, "cover every lens"),
        ("--board", 3, "hold the calibration board"),
    ):
        terminal.pressed = 0
        code, out, err = rig(*capture[:3], "--frames", "3", kind)
        assert (code, terminal.pressed) == (0, pressed), err
        assert words in err
        assert "Next: rig calibrate" in out


def test_a_time_lapse_and_a_run_without_a_terminal_wait_for_nobody(
    rig, file: Path, tmp_path: Path, cameras: Cameras, terminal: Terminal
) -> None:
    file.write_text(file.read_text().replace('pause = "key"', "pause = 3600"))
    capture = ["capture", str(file), "--bracket", "0", "--frames", "3"]
    code, _, err = rig(*capture, str(tmp_path / "lapse"))
    assert (code, terminal.pressed) == (0, 0)
    assert "3600 seconds from now" in err
    assert ", beside 2 pauses of 3600 s; " in err
    assert 2 * 3600 < cameras.clocks[-1].now() < 2 * 3600 + 60
    terminal.is_there = False
    file.write_text(file.read_text().replace("pause = 3600", 'pause = "key"'))
    code, _, err = rig(*capture, str(tmp_path / "key"))
    assert (code, terminal.pressed) == (0, 0)
    assert "Frame 2: move the rig" in err


def test_whoever_goes_on_is_asked_for_the_frame_that_is_next(
    rig, file: Path, tmp_path: Path, cameras: Cameras, terminal
) -> None:
    capture = ["capture", str(file), str(tmp_path / "S"), "--bracket", "0", "--frames", "2"]
    assert rig(*capture)[0] == 0
    index = tmp_path / "S" / "shots.jsonl"
    index.write_bytes(b"".join(index.read_bytes().splitlines(keepends=True)[:-1]))
    (tmp_path / "S" / "raw" / "0001" / "cam1_0.dng").unlink()
    code, _, err = rig(*capture, "--resume")
    assert (code, terminal.pressed) == (0, 2)
    forecast, asked = err.splitlines()
    assert forecast.startswith("Forecast for 1 shot (an earlier run): ")
    assert asked == "Frame 1: move the rig, or what it looks at. Then press Enter."


def test_the_same_thing_is_not_asked_for_twice(terminal: Terminal) -> None:
    said: list[str] = []
    operator = TerminalOperator(said.append, "key", VirtualClock())
    for _ in range(2):
        operator.show("flat")
        operator.move_to(7)
        operator.move_to(8)
    assert (len(said), terminal.pressed) == (1, 1)


def test_where_nobody_is_asked_a_move_is_a_remark(terminal: Terminal) -> None:
    """Suppress it by --quiet; a person who has some seconds is asked nevertheless."""
    asked: list[str] = []
    said: list[str] = []
    terminal.is_there = False
    operator = TerminalOperator(asked.append, "key", VirtualClock(), said.append)
    for frame in range(3):
        operator.move_to(frame)
    assert (asked, len(said)) == ([], 2)
    assert said[1] == "Frame 2: move the rig, or what it looks at."
    operator = TerminalOperator(asked.append, 3.0, VirtualClock(), said.append)
    for frame in range(2):
        operator.move_to(frame)
    assert asked == ["Frame 1: move the rig, or what it looks at. 3 seconds from now it is shot."]


def test_a_filter_wheel_is_waited_for_at_every_band(terminal: Terminal) -> None:
    """Nobody may shoot through the filter before: without a terminal only a pause in seconds is enough."""
    said: list[str] = []
    clock = VirtualClock()
    operator = TerminalOperator(said.append, "key", clock)
    for band in ("450nm", "650nm"):
        operator.turn_to(band)
    assert terminal.pressed == 2
    assert said[1] == "Filter 650nm: turn the wheel of every camera to it. Then press Enter."
    terminal.is_there = False
    with pytest.raises(InputError, match="the filter wheel cannot be turned to 450nm"):
        operator.turn_to("450nm")
    TerminalOperator(said.append, 20.0, clock).turn_to("450nm")
    assert clock.now() == 20.0
