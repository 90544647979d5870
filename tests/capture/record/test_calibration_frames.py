"""Darks, flats and the board in the session of a scene, against what the simulator showed."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from capture.bracket.fixed_exposures import flat_levels
from capture.bracket.planner import Target
from capture.bracket.raw_noise import RawNoise
from capture.capture_rig import capture_rig
from capture.check.check import check
from capture.record.shooting import rehearse
from capture.request import CaptureRequest
from capture.rigfile.rigfile import read_rig_file
from capture.simulated import capture_simulated, simulated_source
from drivers.sim.bus_rig import BusRig
from drivers.sim.rigs import simulate
from imaging.errors import CaptureError, InputError
from imaging.files.raw import read_raw
from imaging.optics.exposure import Exposure
from imaging.sensor.noise import SensorNoise
from imaging.session.records import ShotRecord
from imaging.session.session import Session


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Darks first, then the scene, flats and the board."""
    out = tmp_path_factory.mktemp("full") / "S"
    shoot = {"seed": 3, "out": out}
    capture_simulated("toy", **shoot, kind="dark", frames=3)
    capture_simulated("toy", **shoot, frames=2)
    capture_simulated("toy", **shoot, kind="flat", frames=2)
    capture_simulated("toy", **shoot, kind="board", frames=3)
    return out


def signals(session: Session, shots: list[ShotRecord]) -> np.ndarray:
    """Mean signal of each shot, black 0 and white 1."""
    return np.array([read_raw(session.file(shot)).signal().mean() for shot in shots])


def test_all_is_in_one_sound_session(full: Path) -> None:
    plans = {plan.plan: plan for plan in Session.open(full).plans()}
    assert [(plan.plan, plan.kind) for plan in plans.values()] == [
        ("darks", "dark"),
        ("scene", "scene"),
        ("flats", "flat"),
        ("board", "board"),
    ]
    # The numbers 0 to 2 are those of the rig's positions.
    assert {name: plan.frames for name, plan in plans.items()} == {
        "darks": (3, 4, 5),
        "scene": (0, 1),
        "flats": (6, 7),
        "board": (8, 9, 10),
    }
    report = check(full)
    assert report.problems == ()
    assert report.sound == report.planned == 2 * (3 * 3 + 2 * 3 + 2 * 12 + 3)
    truth = json.loads((full / "truth" / "truth.json").read_text())
    assert truth["dark"]["frames"] == [3, 4, 5]
    assert [one["frame"] for one in truth["frames"]] == [0, 1]


def test_darks_have_the_exposures_of_the_scene_and_no_light(full: Path) -> None:
    session = Session.open(full)
    scene, darks = ({shot.requested for shot in session.shots(kind)} for kind in ("scene", "dark"))
    assert darks == scene
    assert np.abs(signals(session, session.shots("dark"))).max() < 1e-3
    # The same exposure is repeated, not copied.
    assert len({shot.sha256 for shot in session.shots()}) == len(session.shots())


def test_flats_reach_from_ninety_percent_of_white_into_the_noise(full: Path) -> None:
    session = Session.open(full)
    (plan,) = (plan for plan in session.plans() if plan.kind == "flat")
    assert len(plan.bracket) == 12
    matched = re.fullmatch(r"metered: levels down from (\d+)% of white, .*", plan.reason)
    assert matched is not None
    brightest = [read_raw(session.file(s)) for s in session.shots("flat") if s.step == 11]
    percentile = max(
        np.percentile(one.signal()[one.cfa.channels(*one.pixels.shape) == channel], 99.99)
        for one in brightest
        for channel in range(3)
    )
    # Times are named by round numbers, off by up to 0.09 stops, and these are single noisy frames.
    assert percentile == pytest.approx(int(matched[1]) / 100, rel=0.12)
    levels = signals(session, [s for s in session.shots("flat") if s.step == len(plan.bracket) - 1])
    clipped = [read_raw(session.file(shot)).saturated().mean() for shot in session.shots("flat")]
    assert max(clipped) == 0
    # A level further, 1/3 of a stop, the brightest would be above 90 %, were it not for the corners.
    assert 0.4 < levels.max() < 0.9
    assert signals(session, [s for s in session.shots("flat") if s.step == 0]).max() < 0.01
    stops = np.diff([exposure.stops for exposure in plan.bracket])
    np.testing.assert_allclose(stops, 2 / 3, atol=0.1)


def test_the_board_is_held_anew_for_every_pose_and_not_clipped(full: Path) -> None:
    session = Session.open(full)
    shots = session.shots("board")
    assert {shot.requested for shot in shots} == {shots[0].requested}
    assert shots[0].requested is not None
    assert shots[0].requested.time <= 1 / 30
    first = read_raw(session.file(shots[0])).signal()
    assert np.mean([read_raw(session.file(shot)).saturated().mean() for shot in shots]) < 1e-3
    others = [shot for shot in shots if shot.camera == shots[0].camera and shot.frame != shots[0].frame]
    for shot in others:
        assert np.abs(read_raw(session.file(shot)).signal() - first).max() > 0.1


def test_a_second_run_is_a_plan_of_its_own_and_resume_completes_the_last(full: Path, tmp_path: Path) -> None:
    out = tmp_path / "S"
    capture_simulated("toy", out, frames=1, bracket=(-4.0, 0.0))
    for _ in range(2):
        capture_simulated("toy", out, kind="dark", frames=2)
    session = Session.open(out)
    assert [(plan.plan, plan.frames) for plan in session.plans()] == [
        ("scene", (0,)),
        ("darks", (3, 4)),
        ("darks-2", (5, 6)),
    ]
    whole = {path: path.read_bytes() for path in out.rglob("*.dng")}
    lines = (out / "shots.jsonl").read_bytes().splitlines(keepends=True)
    (out / "shots.jsonl").write_bytes(b"".join(lines[:-3]))
    for line in lines[-3:]:
        (out / json.loads(line)["file"]).unlink()
    again = capture_simulated("toy", out, kind="dark", resume=True)
    assert (again.earlier, again.taken) == (5, 3)
    assert {path: path.read_bytes() for path in out.rglob("*.dng")} == whole
    with pytest.raises(InputError, match="was planned with 2 frames, not 16"):
        capture_simulated("toy", out, kind="dark", frames=16, resume=True)


def test_exposures_may_be_given_and_a_rehearsal_writes_nothing(tmp_path: Path) -> None:
    with simulated_source("toy") as source:
        done = rehearse(source, tmp_path / "S", CaptureRequest("board", bracket=(-1.0,)))
        flats = rehearse(source, tmp_path / "S", CaptureRequest("flat"))
    assert ([e.time for e in done.record.bracket], len(done.record.frames)) == ([1 / 125], 20)
    assert len(flats.record.frames) == 16
    assert list(tmp_path.iterdir()) == []


def test_the_scene_is_shot_once(tmp_path: Path) -> None:
    capture_simulated("toy", tmp_path / "S", kind="dark", frames=1)
    capture_simulated("toy", tmp_path / "S", frames=1)
    with pytest.raises(InputError, match="is not empty"):
        capture_simulated("toy", tmp_path / "S", frames=1)
    with pytest.raises(InputError, match="captured with seed 0, not 1"):
        capture_simulated("toy", tmp_path / "S", kind="dark", seed=1)


def lit(bright: float) -> Target:
    """An evenly lit surface before a sensor of 8,180 electrons."""
    return Target(
        "cam0", "G", RawNoise(SensorNoise(gain=3839 / 8180, read_noise=3.0), 3839.0), bright / 1.5, bright
    )


def test_levels_go_down_from_ninety_percent_of_white_as_far_as_the_camera_can() -> None:
    exposures = [Exposure(time=2.0 ** (n / 3), iso=100) for n in range(-30, 10)]
    levels = [exposure.scale * 0.5 for exposure in flat_levels([lit(0.5), lit(0.3)], exposures)]
    assert 0.9 / 2 ** (1 / 3) < levels[-1] <= 0.9
    np.testing.assert_allclose(np.diff(np.log2(levels)), 2 / 3, rtol=1e-9)
    assert len(levels) == 12
    assert len(flat_levels([lit(0.9 * 2.0**8)], exposures)) == 4  # 2, 4/3, 2/3 and 0 stops above the shortest
    with pytest.raises(CaptureError, match="the flat is too bright: 1/1024 s ISO 100 is above"):
        flat_levels([lit(0.91 * 2.0**10)], exposures)


def test_darks_of_a_scene_that_is_still_to_be_metered_are_refused(tmp_path: Path) -> None:
    tables = (
        '[[camera]]\nname = "a"\nserial = "SIM-RAW-001"\n[[camera]]\nname = "b"\nserial = "SIM-RAW-002"\n'
    )
    (tmp_path / "RIG.toml").write_text(tables)
    file = read_rig_file(tmp_path / "RIG.toml")
    for bracket, words in (
        (None, "need the exposures of the scene"),
        ((0.0,), "in the dark it cannot be metered"),
    ):
        rig = simulate("toy")
        bus = BusRig(rig)
        with pytest.raises(InputError, match=words):
            capture_rig(
                file,
                tmp_path / "S",
                kind="dark",
                bracket=bracket,
                operator=rig,
                backend=bus.backend,
                clock=bus.clock,
            )
    assert not (tmp_path / "S").exists()
