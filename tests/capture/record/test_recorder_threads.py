"""The threads of a capture: together at the trigger, apart in their downloads, bounded in memory."""

import math
import threading
from dataclasses import replace

import pytest

from capture.check.check import check
from capture.record import recorder
from capture.record.capture_result import span
from capture.record.recorder import record
from capture.record.threads.memory_budget import MemoryBudget
from drivers.clock import SystemClock
from drivers.sim.usb.virtual_clock import VirtualClock
from imaging.errors import CameraError
from imaging.files import store

SECONDS = {"set_exposure": 0.2, "arm": 0.01, "trigger": 0.001, "collect": 0.5}


def slowed(rig, clock, seconds=None):
    """Let every operation of the rig's cameras take its time on the clock; the log of (when, what, who)."""
    log = []

    def slow(camera, operation):
        act = getattr(camera, operation)

        def acting(*args):
            log.append((round(clock.now(), 6), operation, camera.serial[-1]))
            clock.sleep((seconds or {}).get((camera.serial[-1], operation), SECONDS[operation]))
            result = act(*args)
            if operation == "trigger":
                camera.stamp = result = clock.now()
            return result

        setattr(camera, operation, acting)

    for camera in rig.cameras.values():
        for operation in SECONDS:
            slow(camera, operation)
    return log


def run(rig, clock, **options):
    return record(rig.session, rig.plan, rig.cameras, clock=clock, move_to=rig.move_to, **options)


def when(log, operation, camera):
    return [moment for moment, what, who in log if (what, who) == (operation, camera)]


def test_all_trigger_at_one_moment_also_those_that_stumble_on_the_way(fake_rig):
    rig, clock = fake_rig(a="raw", b="raw", c="raw"), VirtualClock()
    log = slowed(rig, clock, {("b", "set_exposure"): 0.7, ("c", "collect"): 1.9})
    rig.cameras["a"].faults["arm", 3] = CameraError("camera a is busy.")
    rig.cameras["c"].faults["collect", 4] = CameraError("camera c sent half a picture.")
    assert run(rig, clock).missing == ()
    first = [when(log, "trigger", camera) for camera in "abc"]
    # Frame 0: a misses the third step and takes it after the others; frame 1: c takes its first again.
    assert first[0][:2] == first[1][:2] == first[2][:2]
    assert first[1][2] == first[2][2] < first[0][2]
    assert first[0][3:6] == first[1][3:6] == first[2][3:6]
    assert first[2][6] > first[0][5]
    shots = {(s.camera, s.frame, s.step): s for s in rig.session.shots()}
    assert [key for key, shot in shots.items() if shot.retries] == [("a", 0, 2), ("c", 1, 0)]
    assert shots["a", 0, 2].skew == pytest.approx(first[0][2] - first[1][2])
    assert all(shot.skew == pytest.approx(0.0) for shot in shots.values() if not shot.retries)


def test_what_fails_while_the_others_expose_is_taken_again_at_once(fake_rig):
    rig, clock = fake_rig(a="raw", b="raw"), VirtualClock()
    log = slowed(rig, clock, {("a", "collect"): 1.0, ("b", "set_exposure"): 0.01})
    rig.cameras["b"].faults["trigger", 4] = CameraError("camera b did not understand.")
    assert run(rig, clock).missing == ()
    first = [when(log, "trigger", camera) for camera in "ab"]
    assert first[0] == [*first[1][:4], *first[1][5:]]
    shots = {(s.camera, s.frame, s.step): s for s in rig.session.shots()}
    assert [(key, shot.retries) for key, shot in shots.items() if shot.retries] == [(("b", 1, 0), 1)]
    assert shots["b", 1, 0].skew == pytest.approx(0.001 + 0.01 + 0.01 + 0.001 - 0.001)


def test_a_slow_camera_delays_nobodys_download(fake_rig):
    rig, clock = fake_rig(a="raw", b="raw"), VirtualClock()
    log = slowed(rig, clock, {("b", "collect"): 5.0})
    run(rig, clock)
    triggered, emptied = when(log, "trigger", "a"), when(log, "collect", "a")
    # The first frame of all, whose size nobody knows, has the memory to itself.
    assert all(e == pytest.approx(t + 0.001) for t, e in zip(triggered[1:], emptied[1:], strict=True))
    assert clock.now() == pytest.approx(9 * (0.2 + 0.01 + 0.001 + 5.0) + 0.5, abs=0.01)


def test_two_runs_on_a_virtual_clock_are_the_same(fake_rig):
    logs, indices = [], []
    for name in ("one", "two"):
        rig, clock = fake_rig(name, a="raw", b="raw", c="ldr", d="raw"), VirtualClock()
        log = slowed(rig, clock, {("b", "collect"): 0.9})
        rig.cameras["d"].faults["trigger", 2] = CameraError("camera d is busy.")
        run(rig, clock)
        logs.append(log)
        indices.append((rig.session.folder / "shots.jsonl").read_bytes())
    assert logs[0] == logs[1]
    assert indices[0] == indices[1]


def test_a_camera_that_hangs_is_left_behind_and_makes_its_shot_up(fake_rig):
    rig, clock = fake_rig(a="raw", b="raw"), VirtualClock()
    log = slowed(rig, clock)
    ready, calls = rig.cameras["b"].arm, []

    def hangs_once():
        calls.append(clock.now())
        if len(calls) == 2:
            clock.sleep(200.0)
        ready()

    rig.cameras["b"].arm = hangs_once
    assert run(rig, clock).missing == ()
    assert when(log, "trigger", "a")[1] < 35.0
    shots = {(s.camera, s.frame, s.step): s.retries for s in rig.session.shots()}
    # The third step found it gone already, and did not wait a second time.
    assert {key for key, retries in shots.items() if retries} == {("b", 0, 1), ("b", 0, 2)}
    assert when(log, "trigger", "a")[2] < 40.0


def test_frames_between_camera_and_disk_stay_within_the_budget(fake_rig, monkeypatch):
    rig, clock = fake_rig(a="raw", b="raw", c="raw", d="raw"), VirtualClock()
    slowed(rig, clock)
    frame = 24 * 32 * 2
    budgets, held, waiting = [], [], []

    class Watched(MemoryBudget):
        def __init__(self, clock):
            super().__init__(clock, limit=5 * frame)
            budgets.append(self)

        def reserve(self, count):
            waiting.append(self.held + count > self.limit)
            super().reserve(count)
            held.append(self.held)

    monkeypatch.setattr(recorder, "MemoryBudget", Watched)
    assert run(rig, clock).missing == ()
    assert max(held) <= 5 * frame
    assert any(waiting)
    assert budgets[0].held == 0
    assert len(rig.session.shots()) == 36


def test_who_wants_more_memory_than_there_is_waits_until_nobody_has_any():
    clock, log = VirtualClock(), []
    budget = MemoryBudget(clock, limit=10)

    def job(place, name, seconds, count):
        with place:
            clock.sleep(seconds)
            budget.reserve(count)
            log.append((clock.now(), name))
            clock.sleep(1.0)
            budget.release(count)

    jobs = [("small", 0.0, 6), ("large", 0.1, 50), ("other", 0.2, 4)]
    threads = [
        threading.Thread(target=job, args=(clock.worker(name), name, seconds, count))
        for name, seconds, count in jobs
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert log == [(0.0, "small"), (0.2, "other"), (pytest.approx(1.2), "large")]


def test_on_the_machines_clock_downloads_and_writing_run_at_the_same_time(fake_rig, monkeypatch):
    """Each of two downloads ends only when the other has begun, and a file only when the next one has."""
    rig = fake_rig(a="raw", b="raw")
    both = threading.Barrier(2, timeout=20.0)
    next_shot, write = threading.Event(), store.write_pieces
    collects = {name: camera.collect for name, camera in rig.cameras.items()}

    def collect(name):
        first = not any(camera.calls.count("collect") for camera in rig.cameras.values())
        if not first and rig.cameras[name].calls.count("collect") == 1:
            both.wait()
        return collects[name]()

    def armed(act):
        def arm():
            if rig.cameras["a"].calls.count("arm") == 1:
                next_shot.set()
            act()

        return arm

    def written(path, pieces):
        if path.name.startswith("a_0"):
            assert next_shot.wait(20.0)
        write(path, pieces)

    for name, camera in rig.cameras.items():
        monkeypatch.setattr(camera, "collect", lambda name=name: collect(name))
        monkeypatch.setattr(camera, "arm", armed(camera.arm))
    monkeypatch.setattr(store, "write_pieces", written)
    rig.plan = replace_frames(rig.plan, (0,))
    assert run(rig, SystemClock()).missing == ()


def replace_frames(plan, frames):
    return plan.model_copy(update={"frames": frames})


def test_ctrl_c_ends_all_threads_and_leaves_a_session_that_can_be_completed(fake_rig):
    whole, rig = fake_rig("whole"), fake_rig("broken")
    run(whole, VirtualClock())
    before = threading.active_count()

    def interrupt(message, done, total):
        if done == 3:
            raise KeyboardInterrupt

    for clock in (VirtualClock(), SystemClock()):
        with pytest.raises(KeyboardInterrupt):
            run(rig, clock, progress=interrupt)
        assert threading.active_count() == before
        assert len(rig.session.shots()) == 3
        assert not list(rig.session.folder.rglob("*.part"))
        for shot in rig.session.shots():
            assert store.sha256(rig.session.file(shot)) == shot.sha256
        (rig.session.folder / "shots.jsonl").unlink()
    assert run(rig, SystemClock()).taken == 18
    assert [store.sha256(whole.session.file(shot)) for shot in whole.session.shots()] == [
        shot.sha256 for shot in rig.session.shots()
    ]


def test_a_defect_in_the_writing_thread_surfaces(fake_rig, monkeypatch):
    rig = fake_rig(a="raw")

    def broken(path, pieces):
        raise ZeroDivisionError

    monkeypatch.setattr(store, "write_pieces", broken)
    with pytest.raises(ZeroDivisionError):
        run(rig, VirtualClock())


def test_shutters_that_open_too_far_apart_are_told_once_a_step(fake_rig):
    rig, clock = fake_rig(a="raw", b="raw"), VirtualClock()
    slowed(rig, clock, {("b", "trigger"): 0.041})
    result = run(rig, clock, tolerance=0.02)
    assert len(result.problems) == 3
    assert result.problems[0].startswith(
        "step 0: in 3 of 3 frames the shutters opened more than 20 ms apart, up to 40 ms (b, frame "
    )
    assert run(fake_rig("other", a="raw"), clock, tolerance=0.02).problems == ()


@pytest.mark.parametrize("silent", ["b", "ab", "bc", "abc"])
def test_the_skew_of_a_camera_that_does_not_stamp_its_frames_is_unknown(fake_rig, silent):
    """Keep the time of the order apart from that of the shutter."""
    rig, clock = fake_rig(a="raw", b="raw", c="raw"), VirtualClock()
    slowed(rig, clock, {("c", "trigger"): 0.011})
    for name in silent:
        rig.cameras[name].stamps = False
    result = run(rig, clock)
    (unknown,) = result.unknown
    assert unknown.startswith(f"the skew of {', '.join(silent)} is unknown, at most ")
    for shot in rig.session.shots():
        assert shot.trigger_delay == pytest.approx(0.01 if shot.camera == "c" else 0.0)
        # Nor has the only one that stamps any to be compared with.
        known = silent == "b" and shot.camera != "b"
        assert shot.skew == (pytest.approx(shot.trigger_delay) if known else None)
        assert (shot.skew_bound is None) == known
    report = check(rig.session.folder)
    assert report.untimed == (tuple(silent) if silent == "b" else ("a", "b", "c"))
    most = max(shot.skew_bound or 0.0 for shot in rig.session.shots())
    assert report.untimed_bound == most
    assert f"at most {span(most)}: " in unknown


def test_it_does_not_matter_when_a_dark_is_exposed(fake_rig):
    rig = fake_rig(a="raw", b="raw")
    rig.plan = rig.plan.model_copy(update={"kind": "dark", "plan": "dark"})
    rig.session.append_plan(rig.plan)
    rig.cameras["b"].stamps = False
    assert run(rig, VirtualClock()).unknown == ()
    assert check(rig.session.folder).untimed == ()


@pytest.mark.parametrize("lag", [0.0, 0.08, 0.3])
@pytest.mark.parametrize("listens", [False, True])
def test_no_shutter_opens_later_than_the_bound_of_its_skew(fake_rig, lag, listens):
    """a opens at once; b some time after it was told, or, on a wire, before it was asked for the frame."""
    rig, clock = fake_rig(a="raw", b="raw"), VirtualClock()
    slowed(rig, clock, {("b", "trigger"): 0.1 if listens else 0.001, ("b", "collect"): lag + 0.2})
    true = {}
    for name, camera in rig.cameras.items():
        camera.stamps = False
        trigger = camera.trigger

        def noted(name=name, trigger=trigger):
            moment = trigger()
            shot = true.setdefault(name, [])
            shot.append(moment if name == "a" else moment + lag)
            return moment

        camera.trigger = noted
    run(rig, clock)
    of = {name: [shot for shot in rig.session.shots() if shot.camera == name] for name in "ab"}
    for number, (first, second) in enumerate(zip(true["a"], true["b"], strict=True)):
        skew = second - min(first, second)
        assert of["b"][number].skew is None
        time = of["b"][number].reported.time
        assert skew <= of["b"][number].skew_bound
        if number:  # while no size is known, b waits until a's frame is down
            assert of["b"][number].skew_bound <= skew + 0.3 + 0.1 * time


def test_a_camera_that_stamps_its_frames_knows_best_when_it_opened(fake_rig):
    rig, clock = fake_rig(a="raw", b="raw"), VirtualClock()
    slowed(rig, clock)
    collect = rig.cameras["b"].collect

    def stamped():
        frame = collect()
        opened = rig.cameras["b"].clock_of_trigger + 0.003
        return replace(frame, metadata=replace(frame.metadata, opened=opened))

    trigger = rig.cameras["b"].trigger

    def noted():
        rig.cameras["b"].clock_of_trigger = trigger()
        return rig.cameras["b"].clock_of_trigger

    rig.cameras["b"].collect, rig.cameras["b"].trigger = stamped, noted
    run(rig, clock)
    skews = {shot.camera: shot.skew for shot in rig.session.shots()}
    assert skews == {"a": pytest.approx(0.0), "b": pytest.approx(0.003)}
    assert all(shot.trigger_delay == pytest.approx(0.0) for shot in rig.session.shots())
    assert math.isfinite(clock.now())
