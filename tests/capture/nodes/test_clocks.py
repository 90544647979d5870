"""The clock of another host, and one moment for several."""

from itertools import cycle

import pytest

from capture.nodes.clocks import DRIFT, EVERY, QUESTIONS, ClockReading, ComparedClock, Release


class Hand:
    """A clock that is moved by hand."""

    def __init__(self) -> None:
        self.time = 100.0

    def now(self) -> float:
        return self.time


class Other:
    """A clock elsewhere: ahead, drifting; ways there and back of different and changing length."""

    def __init__(self, hand: Hand, ahead: float, drift: float, ways: list[tuple[float, float]]) -> None:
        self._hand, self._ahead, self._drift = hand, ahead, drift
        self._ways = cycle(ways)
        self.asked = 0

    def jump(self, by: float) -> None:
        self._ahead += by

    def offset(self) -> float:
        return self._ahead + self._drift * (self._hand.time - 100.0)

    def ask(self) -> float:
        self.asked += 1
        there, back = next(self._ways)
        self._hand.time += there
        answer = self._hand.time + self.offset()
        self._hand.time += back
        return answer


WAYS = [(0.004, 0.0001), (0.0003, 0.0002), (0.02, 0.03), (0.0001, 0.0009)]


@pytest.mark.parametrize("ahead", [0.0, 12345.678, -3.2])
@pytest.mark.parametrize("drift", [0.0, DRIFT, -DRIFT])
def test_the_offset_is_found_within_its_error(ahead: float, drift: float) -> None:
    hand = Hand()
    other = Other(hand, ahead, drift, WAYS)
    compared = ComparedClock(other.ask, hand)
    for pause in (0.0, 0.5, 0.9, 3.0, 40.0, 0.2):
        hand.time += pause
        reading = compared.reading()
        assert abs(reading.offset - other.offset()) <= reading.error
        assert reading.error < 0.00025 + EVERY * DRIFT + 0.3 * DRIFT  # the shortest way, and the drift since


def test_what_is_known_well_takes_one_question() -> None:
    hand = Hand()
    other = Other(hand, 1.0, 0.0, [(0.001, 0.001)])
    compared = ComparedClock(other.ask, hand)
    compared.reading()
    assert other.asked == QUESTIONS
    compared.reading()
    assert other.asked == QUESTIONS + 1
    hand.time += EVERY + 0.01
    compared.reading()
    assert other.asked == 2 * QUESTIONS + 1


@pytest.mark.parametrize("by", [0.03, -0.03, 2.0, -2.0])
@pytest.mark.parametrize("pause", [0.0, 0.3, 5.0])
def test_a_clock_that_jumps_is_told_once_and_compared_anew(by: float, pause: float) -> None:
    hand, jumps = Hand(), []
    other = Other(hand, 12.0, 0.0, [(0.0008, 0.0002)])
    compared = ComparedClock(other.ask, hand, jumps.append)
    for _ in range(4):  # of which any may be the sharpest
        hand.time += 1.1
        before = compared.reading()
    hand.time += pause
    assert compared.since(before) == before
    other.jump(by)
    covering = compared.since(before)
    for offset in (12.0, 12.0 + by):
        assert abs(covering.offset - offset) <= covering.error
    assert covering.error < abs(by) / 2 + 0.004
    after = compared.reading()
    assert abs(after.offset - other.offset()) <= after.error < 0.003
    assert jumps == [pytest.approx(by, abs=0.002)]
    hand.time += 5.0
    assert abs(compared.reading().offset - other.offset()) < 0.001
    assert len(jumps) == 1


def test_a_thread_that_comes_late_does_not_bring_the_old_clock_back() -> None:
    hand, jumps = Hand(), []
    compared = ComparedClock(lambda: hand.time, hand, jumps.append)
    compared._add(ClockReading(100.0, 0.0, 0.001))
    compared._add(ClockReading(102.0, 2.0, 0.001))
    compared._add(ClockReading(101.0, 0.0, 0.0001))
    assert jumps == [2.0]
    assert [reading.offset for reading in compared._readings] == [2.0]


def test_a_host_that_was_started_again_has_another_clock() -> None:
    hand = Hand()
    clocks = [Other(hand, 5.0, 0.0, [(0.0001, 0.0001)]), Other(hand, -70.0, 0.0, WAYS)]
    compared = ComparedClock(lambda: clocks[0].ask(), hand)
    assert compared.reading().offset == pytest.approx(5.0, abs=1e-3)
    del clocks[0]
    compared.forget()
    assert compared.reading().offset == pytest.approx(-70.0, abs=1e-3)


def test_those_who_come_in_time_are_released_at_one_moment_a_little_ahead() -> None:
    hand = Hand()
    release = Release(hand)
    first = release.moment()
    assert first == hand.time + Release.AHEAD
    hand.time += Release.AHEAD - 1.01 * Release.LEAST
    assert release.moment() == first
    hand.time += 0.02 * Release.LEAST
    assert release.moment() == hand.time + Release.AHEAD
