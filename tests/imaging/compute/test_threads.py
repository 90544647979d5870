"""Work on all threads, whose results come in their order."""

import threading
from contextlib import suppress
from contextvars import ContextVar

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from imaging.compute import threads
from imaging.compute.threads import in_turn, one_thread_a_product


@pytest.fixture(autouse=True)
def two(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "_threads", 2)


def test_results_come_in_turn_though_two_are_under_way() -> None:
    meeting = threading.Barrier(2, timeout=20.0)

    def work(number: int) -> int:
        meeting.wait()  # which one at a time would never pass
        return number**2

    assert list(in_turn(10, work)) == [number**2 for number in range(10)]


def test_who_stops_has_little_begun_ahead() -> None:
    begun: list[int] = []

    def work(number: int) -> int:
        begun.append(number)
        return number

    results = in_turn(1000, work)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    results.close()
    assert len(begun) <= 3 + 2 * 2 + 1


def test_an_error_is_raised_in_its_turn() -> None:
    def work(number: int) -> int:
        if number == 2:
            raise ValueError("two")
        return number

    results = in_turn(9, work)
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ValueError, match="two"):
        next(results)
    assert list(in_turn(0, work)) == []


def blas_threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_products_are_made_on_the_thread_that_asks() -> None:
    @one_thread_a_product()
    def within() -> set[int]:
        return blas_threads()

    before = blas_threads()
    assert np.ones((2, 2)).sum() == 4  # numpy's is loaded
    assert within() == {1}
    assert {one for threads in in_turn(3, lambda number: blas_threads()) for one in threads} == {1}
    assert blas_threads() == before


def test_work_in_turn_has_the_context_of_the_caller_and_no_more_threads_than_it_may() -> None:
    level: ContextVar[int] = ContextVar("level", default=0)
    level.set(3)
    at_once, most, lock = 0, 0, threading.Lock()
    gate = threading.Barrier(2, timeout=0.05)

    def work(number: int) -> int:
        nonlocal at_once, most
        with lock:
            at_once += 1
            most = max(most, at_once)
        with suppress(threading.BrokenBarrierError):
            gate.wait()  # until another comes, or for a moment
        with lock:
            at_once -= 1
        return number * level.get()

    threads.set_threads(8)  # the fixture puts it back
    assert list(in_turn(6, work, most=2)) == [0, 3, 6, 9, 12, 15]
    assert most <= 2
