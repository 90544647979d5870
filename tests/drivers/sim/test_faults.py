"""Fault scripts: addressed by camera, operation and nth time, or drawn with a seed; and logged."""

from collections import Counter
from itertools import chain

import pytest

from drivers.sim.faults import EVERY, ROUGH, Fault, FaultPlan, Happened, Kind, Mix
from drivers.sim.usb.virtual_clock import VirtualClock

ALL = frozenset(Kind)


def test_a_script_hits_one_camera_one_operation_one_time() -> None:
    clock = VirtualClock()
    busy = Fault(Kind.BUSY, "B", "GetObject", nth=2, seconds=0.1)
    plan = FaultPlan(clock, [busy])
    calls = [("A", "GetObject"), ("B", "GetObject"), ("B", "GetStorageIDs"), ("A", "GetObject")]
    assert not any(plan.strike(*call, ALL) for call in calls)
    clock.sleep(2.0)
    assert plan.strike("B", "GetObject", ALL) == (busy,)
    assert plan.strike("B", "GetObject", ALL) == ()
    assert plan.log == [Happened(2.0, "B", "GetObject", 2, busy)]


def test_any_operation_counts_all_of_a_cameras_and_several_faults_strike_together() -> None:
    third = Fault(Kind.STALL, EVERY, EVERY, nth=3)
    late = Fault(Kind.LATE_EVENT, "A", "shoot", nth=1, seconds=1.0)
    plan = FaultPlan(VirtualClock(), [third, late])
    assert plan.strike("A", "x", ALL) == plan.strike("A", "y", ALL) == plan.strike("B", "x", ALL) == ()
    assert plan.strike("A", "shoot", ALL) == (third, late)


def test_nth_zero_is_every_time() -> None:
    split = Fault(Kind.SPLIT_HEADER, nth=0)
    plan = FaultPlan(VirtualClock(), [split])
    assert [plan.strike("A", name, ALL) for name in "xyx"] == 3 * [(split,)]


def test_a_fault_strikes_only_where_it_can() -> None:
    plan = FaultPlan(VirtualClock(), [Fault(Kind.LOST_EVENT)])
    assert plan.strike("A", "GetObject", frozenset({Kind.BUSY})) == ()
    assert plan.log == []


def draws(seed: int, serials: list[str], mix: Mix = ROUGH) -> dict[str, list[Fault]]:
    plan = FaultPlan(VirtualClock(), mix=mix, seed=seed)
    for index in range(4000):
        for serial in serials:
            plan.strike(serial, f"operation {index % 7}", ALL)
    return {serial: [one.fault for one in plan.log if one.serial == serial] for serial in serials}


def test_draws_depend_on_the_seed_and_on_no_other_camera() -> None:
    assert draws(1, ["A", "B"])["A"] == draws(1, ["A"])["A"]
    assert draws(1, ["A"])["A"] != draws(2, ["A"])["A"]


def test_draws_have_the_share_and_the_mix_that_was_asked_for() -> None:
    faults = list(chain(*draws(3, ["A", "B", "C"]).values()))
    assert len(faults) / 12000 == pytest.approx(0.05, abs=0.006)
    counts = Counter(fault.kind for fault in faults)
    assert counts[Kind.BUSY] / len(faults) == pytest.approx(0.80, abs=0.05)
    assert (counts[Kind.LOST_EVENT] + counts[Kind.LATE_EVENT]) / len(faults) == pytest.approx(0.15, abs=0.05)
    assert set(counts) <= set(ROUGH.weights)
    busy = [fault.seconds for fault in faults if fault.kind is Kind.BUSY]
    assert min(busy) > 0.0
    assert max(busy) <= 0.1
    assert not any(fault.count for fault in faults if fault.kind is Kind.BUSY)


def test_a_draw_takes_the_kinds_an_operation_can_have() -> None:
    plan = FaultPlan(VirtualClock(), mix=Mix(1.0, ROUGH.weights), seed=1)
    for _ in range(50):
        (fault,) = plan.strike("A", "GetObject", frozenset({Kind.STALL, Kind.SLOW_CARD}))
        assert fault.kind is Kind.STALL


def test_unplugging_is_drawn_with_a_byte_and_a_time() -> None:
    faults = draws(1, ["A"], Mix(0.01, {Kind.UNPLUG: 1.0}, away=0.5))["A"]
    assert len({fault.count for fault in faults}) > len(faults) / 2
    assert all(fault.count > 0 and 0.0 < fault.seconds <= 0.5 for fault in faults)
