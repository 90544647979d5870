"""Forecasts of a shoot, against the clock of simulated cameras and the files that they leave."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from capture.connected_rig import connected_source
from capture.record import forecast as forecasts
from capture.record.forecast import ASSUMED, Forecast
from capture.record.shooting import rehearse, shoot
from capture.record.source import Source
from capture.request import CaptureRequest, RigRequest
from capture.rigfile.rigfile import read_rig_file
from drivers.sim.bus_rig import VISION, BusRig
from drivers.sim.rigs import simulate
from imaging.errors import InputError
from imaging.session.session import Session

RIG = """
frames = 2
pause = 0
[bracket]
exposures = [-4, 0, 3]
time = "1/60"
f_number = 8
"""
CAMERA = '[[camera]]\nname = "cam{n}"\nserial = "SIM-RAW-{serial:03d}"\n'


@dataclass
class Rig:
    """A rig of two cameras, on a new bus for each command. moving: seconds that a person takes to move."""

    folder: Path
    model: str = "generic"
    bandwidth: float | None = None
    moving: float = 0.0

    @contextmanager
    def source(self) -> Iterator[Source]:
        path = self.folder / "RIG.toml"
        path.write_text(RIG + "".join(CAMERA.format(n=n, serial=n + 1) for n in range(2)))
        rig = simulate("toy", 0, samples=1)
        bus = BusRig(rig, model=self.model, bandwidth=self.bandwidth)

        class Slow:
            """The simulator, with a person's pace."""

            show, turn_to = rig.show, rig.turn_to

            def move_to(person, frame: int) -> None:
                bus.clock.sleep(self.moving)
                rig.move_to(frame)

        request = RigRequest(operator=Slow(), positions=rig.frames, backend=bus.backend, clock=bus.clock)
        with connected_source(read_rig_file(path), request) as source:
            yield source

    def rehearse(self, name: str = "S", **options: Any) -> Forecast:
        with self.source() as source:
            return rehearse(source, self.folder / name, CaptureRequest(**options)).forecast

    def shoot(self, **options: Any) -> tuple[Any, list[Forecast]]:
        announced: list[Forecast] = []
        with self.source() as source:
            request = CaptureRequest(**options)
            result = shoot(source, self.folder / "S", request, announce=announced.append)
        return result, announced


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


@pytest.mark.parametrize("model", ["generic", "nikon-z6", VISION])
def test_test_shots_forecast_seconds_and_bytes(rig: Rig, model: str) -> None:
    rig.model, rig.moving = model, 30.0
    forecast = rig.rehearse()
    assert not (rig.folder / "S").exists()
    assert (forecast.basis, forecast.shots, forecast.frames) == ("test shots", 12, 2)
    run = rig.shoot()[0].run
    assert 0.9 < forecast.seconds / run.seconds < 1.1
    assert 0.99 < forecast.size / run.bytes < 1.01
    files = [path.stat().st_size for path in (rig.folder / "S" / "raw").rglob("*.*")]
    assert run.bytes == sum(files)
    assert Session.open(rig.folder / "S").runs() == [run]


def test_on_one_slow_bus_the_clock_is_between_the_two_forecasts(rig: Rig) -> None:
    rig.bandwidth = 20_000.0
    forecast = rig.rehearse()
    run = rig.shoot()[0].run
    assert forecast.seconds < run.seconds < forecast.on_one_bus


def test_what_is_metered_is_forecast_by_the_test_shots_of_the_meter(rig: Rig) -> None:
    rig.shoot()
    result, (announced,) = rig.shoot(kind="flat", frames=2)
    assert announced.basis == "test shots"
    assert 0.85 < announced.seconds / result.run.seconds < 1.15
    assert announced.size == result.run.bytes


def test_without_test_shots_an_earlier_run_counts_or_else_an_assumption(rig: Rig) -> None:
    _, (first,) = rig.shoot()
    exposed = 2 * sum(2.0**stop / 60 for stop in (-4, 0, 3))
    assert first.basis.startswith("assumed")
    assert first.seconds == pytest.approx(6 * ASSUMED + exposed, rel=0.01)
    result, (second,) = rig.shoot(kind="dark", frames=3)
    assert second.basis == "an earlier run"
    assert 0.95 < second.seconds / result.run.seconds < 1.05
    assert second.size == result.run.bytes


def test_a_resumed_shoot_is_forecast_by_what_is_missing(rig: Rig) -> None:
    rig.shoot()
    shots = rig.folder / "S" / "shots.jsonl"
    shots.write_text("".join(shots.read_text().splitlines(keepends=True)[:7]))
    assert rig.rehearse(resume=True).shots == 5
    with pytest.raises(InputError, match="is not empty"):
        rig.rehearse()
    resumed, (rest,) = rig.shoot(resume=True)
    assert rest.shots == resumed.taken == 5
    assert rest.size == resumed.run.bytes
    nothing, none = rig.shoot(resume=True)
    assert (nothing.run, none) == (None, [])
    assert rig.rehearse(resume=True).shots == 0
    with pytest.raises(InputError, match="is not a folder: leave --resume out"):
        rig.rehearse("T", resume=True)
    (rig.folder / "F").touch()
    with pytest.raises(InputError, match="F is a file: name a new folder"):
        rig.rehearse("F")


def test_a_disk_that_is_too_small_is_told_before_the_first_shot(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    forecast = rig.rehearse()
    assert forecast.fits
    monkeypatch.setattr(forecasts.shutil, "disk_usage", lambda path: SimpleNamespace(free=forecast.size - 1))
    assert not rig.rehearse().fits
