"""Virtual time: it passes when all wait, events keep their order, and threads change nothing."""

import math
import random
import threading
import time
from collections.abc import Callable

import pytest

from drivers.sim.usb import virtual_clock
from drivers.sim.usb.timeline import LiveTimeline
from drivers.sim.usb.virtual_clock import ClockStopped, VirtualClock


def run(clock: VirtualClock, jobs: dict[str, Callable[[], None]]) -> None:
    """Each job in a thread of its own, all workers of the clock."""
    places = {name: clock.worker(name) for name in jobs}

    def work(name: str) -> None:
        with places[name]:
            jobs[name]()

    threads = [threading.Thread(target=work, args=(name,)) for name in jobs]
    random.Random().shuffle(threads)  # the order of starting must not matter
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def story(seed: int) -> list[tuple[float, str]]:
    """Log of six workers, events and a barrier between the workers."""
    clock, log, arrived = VirtualClock(), [], []

    def job(name: str) -> None:
        dice = random.Random(f"{seed} {name}")
        for step in range(8):
            # Few different times, so that many fall together.
            clock.sleep(dice.choice((0.0, 0.01, 0.02)))
            log.append((clock.now(), f"{name} slept {step}"))
            clock.call_later(0.01, lambda step=step: log.append((clock.now(), f"event of {name} {step}")))
        arrived.append(name)
        clock.wait(lambda: len(arrived) == 6, math.inf)
        log.append((clock.now(), f"{name} passed"))
        clock.sleep(1.0)

    run(clock, {f"worker {index}": lambda index=index: job(f"worker {index}") for index in range(6)})
    return log


def test_a_long_wait_takes_no_time() -> None:
    clock, began = VirtualClock(), time.monotonic()
    clock.sleep(30.0)
    clock.sleep(3600.0)
    assert clock.now() == 3630.0
    assert time.monotonic() - began < 1.0


def test_equal_seeds_give_equal_logs_whatever_the_threads_do() -> None:
    stories = [story(1) for _ in range(20)]
    assert len(stories[0]) == 6 * 17
    assert all(one == stories[0] for one in stories)
    assert [moment for moment, _ in stories[0]] == sorted(moment for moment, _ in stories[0])
    assert story(2) != stories[0]


def test_events_of_one_moment_keep_the_order_of_their_making() -> None:
    clock, log = VirtualClock(), []
    for index in range(5):
        clock.call_later(0.5, lambda index=index: log.append(index))
    clock.call_later(0.25, lambda: clock.call_later(0.25, lambda: log.append("nested")))
    clock.sleep(1.0)
    assert log == [0, 1, 2, 3, 4, "nested"]


def test_time_stands_while_a_worker_runs_or_is_still_to_come() -> None:
    clock, log, release = VirtualClock(), [], threading.Event()

    def busy() -> None:
        release.wait(10.0)  # working, not waiting on the clock
        log.append(("busy", clock.now()))

    def sleeper() -> None:
        clock.sleep(5.0)
        log.append(("sleeper", clock.now()))

    places = clock.worker("sleeper"), clock.worker("busy")

    def enter(place: virtual_clock.Worker, job: Callable[[], None]) -> None:
        with place:
            job()

    threads = [
        threading.Thread(target=enter, args=pair) for pair in zip(places, (sleeper, busy), strict=True)
    ]
    threads[0].start()
    assert not log
    threads[1].start()
    release.set()
    for thread in threads:
        thread.join()
    assert log == [("busy", 0.0), ("sleeper", 5.0)]


def test_a_wait_ends_with_its_condition_or_with_its_time() -> None:
    clock, calls = VirtualClock(), []
    clock.call_later(0.2, lambda: calls.append("there"))
    assert clock.wait(lambda: bool(calls), 1.0)
    assert clock.now() == 0.2
    assert not clock.wait(lambda: len(calls) > 1, 1.0)
    assert clock.now() == pytest.approx(1.2)


def test_workers_that_wait_for_ever_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(virtual_clock, "_PATIENCE", 0.01)
    with pytest.raises(ClockStopped, match="MainThread waits"):
        VirtualClock().wait(lambda: False, math.inf)


def test_live_time_keeps_appointments_in_order() -> None:
    timeline, log = LiveTimeline(), []
    timeline.call_later(0.002, lambda: log.append("second"))
    timeline.call_later(0.001, lambda: log.append("first"))
    assert timeline.wait(lambda: len(log) == 2, 10.0)
    assert log == ["first", "second"]
    timeline.close()


def test_no_time_passes_within_an_action_that_makes_appointments() -> None:
    clock, log = VirtualClock(), []

    def act() -> None:
        clock.call_later(0.5, lambda: log.append(("later", clock.now())))
        log.append(("now", clock.now()))

    clock.call_later(1.0, act)
    clock.sleep(2.0)
    assert log == [("now", 1.0), ("later", 1.5)]
