"""The planner against brute force over small lists, and against ranges whose answer is known."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.capture import planner_cases as cases
from capture.bracket.exposure_choices import common_isos, common_times, exposure_list, without_idle_isos
from capture.bracket.goals import BracketGoals
from capture.bracket.planner import BALANCE, SLACK, BracketPlan, Shortfall, Target, plan_bracket
from capture.bracket.raw_noise import RawNoise
from drivers.camera import Capabilities
from imaging.errors import CaptureError, InputError
from imaging.optics.exposure import Exposure
from imaging.sensor.noise import SensorNoise

# Wells of 8,180, 32,400 and 42,000 electrons: a Pi HQ, an IMX249 and a full-frame camera.
SENSORS = (
    RawNoise(SensorNoise(gain=3839 / 8180, read_noise=3.0), 3839.0),
    RawNoise(SensorNoise(gain=3839 / 32400, read_noise=7.2), 3839.0),
    RawNoise(SensorNoise(gain=15871 / 42000, read_noise=1.5), 15871.0),
)
THIRDS = tuple(2.0 ** (n / 3) for n in range(-39, 16))
"""1/8192 s to 32 s."""


ANY = BracketGoals()


def listed(times=THIRDS, isos=(100.0,), wanted=ANY) -> tuple[Exposure, ...]:
    return exposure_list(times, isos, 4.0, wanted)


def stops_of(noise: RawNoise, snr: float) -> float:
    """Stops that one exposure is trusted to show."""
    exposure = Exposure(time=1.0, iso=100.0)
    return math.log2(noise.brightest(exposure) / noise.darkest(snr, exposure)) - 2 * SLACK


def scene(noise: RawNoise, stops: float, dark: float = 4.0) -> Target:
    return Target("cam0", "G", noise, dark, dark * 2.0**stops)


def shown(exposure: Exposure, target: Target, snr: float, radiance: float) -> bool:
    """Straight from the definition: enough SNR, and not clipped, with the slack at both ends."""
    trusted = 2.0**SLACK
    enough = target.noise.snr(radiance / trusted, exposure) >= snr - 1e-9
    return enough and radiance * trusted <= target.noise.brightest(exposure) * (1 + 1e-9)


def checkpoints(targets, exposures, snr) -> list[tuple[Target, float]]:
    """Radiances that stand for all: every end of an interval within a target, and between any two."""
    points = []
    for target in targets:
        ends = {target.dark, target.bright}
        for exposure in exposures:
            for end in (
                target.noise.darkest(snr, exposure) * 2**SLACK,
                target.noise.brightest(exposure) / 2**SLACK,
            ):
                if target.dark < end < target.bright:
                    ends.add(end)
        ordered = sorted(ends)
        # An end itself belongs to the interval; rounding is kept away from it by the middles.
        points += [(target, target.dark), (target, target.bright)]
        points += [(target, math.sqrt(a * b)) for a, b in itertools.pairwise(ordered) if b > a * (1 + 1e-6)]
    return points


def worst_hand_over(subset, targets, snr) -> float:
    """The least SNR, dB, that is left right above where one exposure of a bracket clips."""
    worst = math.inf
    for exposure in subset:
        for target in targets:
            end = target.noise.brightest(exposure) / 2**SLACK
            if target.dark <= end < target.bright:
                above = end * (1 + 1e-9)
                best = max(
                    (
                        target.noise.snr(end, e)
                        for e in subset
                        if e.time * e.iso < exposure.time * exposure.iso and shown(e, target, snr, above)
                    ),
                    default=math.inf,
                )
                worst = min(worst, best)
    return worst


@settings(max_examples=150)
@given(
    times=st.lists(st.sampled_from(THIRDS), min_size=1, max_size=7, unique=True),
    isos=st.sampled_from([(100.0,), (100.0, 400.0)]),
    ranges=st.lists(
        st.tuples(st.integers(0, 2), st.floats(-4, 14), st.floats(0, 16)), min_size=1, max_size=4
    ),
    snr=st.sampled_from([0.0, 10.0, 20.0, 30.0]),
)
def test_no_bracket_does_with_fewer_exposures_and_none_as_quick_hands_over_better(times, isos, ranges, snr):
    exposures = listed(times, isos)
    targets = [
        Target(f"cam{i}", "G", SENSORS[kind], 2.0**low, 2.0 ** (low + stops))
        for i, (kind, low, stops) in enumerate(ranges)
    ]
    plan = plan_bracket(targets, exposures, BracketGoals(snr=snr))
    points = checkpoints(targets, exposures, snr)
    shows = {
        e: {n for n, (target, radiance) in enumerate(points) if shown(e, target, snr, radiance)}
        for e in exposures
    }
    possible = set().union(*shows.values())
    assert set().union(*(shows[e] for e in plan.exposures)) == possible
    assert bool(plan.shortfalls) == (len(possible) < len(points))
    if possible:
        for count in range(1, len(plan.exposures) + 1):
            covers = [
                subset
                for subset in itertools.combinations(exposures, count)
                if set().union(*(shows[e] for e in subset)) == possible
            ]
            assert count == len(plan.exposures) or not covers
        most = BALANCE * min(sum(e.time for e in subset) for subset in covers) * (1 + 1e-9)
        quick = [subset for subset in covers if sum(e.time for e in subset) <= most]
        assert plan.total <= most
        best = max(worst_hand_over(subset, targets, snr) for subset in quick)
        assert worst_hand_over(plan.exposures, targets, snr) == pytest.approx(best, abs=1e-6)


@pytest.mark.parametrize("noise", SENSORS)
@pytest.mark.parametrize("snr", [10.0, 20.0, 30.0])
def test_the_number_of_exposures_is_the_range_over_what_one_shows(noise, snr):
    """A list in thirds of a stop loses at most a third at every seam."""
    one = stops_of(noise, snr)
    exposures = listed([2.0 ** (n / 3) for n in range(-120, 16)])
    for count in (1, 2, 3):
        target = scene(noise, count * one - (count + 1) / 3)
        plan = plan_bracket([target], exposures, BracketGoals(snr=snr))
        assert (len(plan.exposures), plan.shortfalls) == (count, ())
        more = scene(noise, count * one + 0.05)
        assert len(plan_bracket([more], exposures, BracketGoals(snr=snr)).exposures) == count + 1


def test_published_dynamic_range_follows_from_the_noise():
    """A well of 8,180 electrons, 3 of read noise (IMX477): 6.1 stops at 20 dB, 2.9 at 30, up to 0.9 of it."""
    noise = RawNoise(SensorNoise(gain=1.0, read_noise=3.0), 8180.0)
    exposure = Exposure(time=1.0)
    for snr, stops in ((20.0, 6.1), (30.0, 2.9)):
        darkest = noise.darkest(snr, exposure)
        assert math.log2(0.9 / darkest) == pytest.approx(stops, abs=0.06)
        assert noise.snr(darkest, exposure) == pytest.approx(snr, abs=1e-9)


def test_cameras_that_see_different_light_share_the_exposures():
    dim, lit = scene(SENSORS[1], 2.0, dark=1.0), Target("cam1", "G", SENSORS[0], 2.0**10, 2.0**12)
    plan = plan_bracket([dim, lit], listed(), BracketGoals())
    assert len(plan.exposures) == 2
    assert len(plan_bracket([dim, dim], listed(), BracketGoals()).exposures) == 1


def shortfalls(plan: BracketPlan) -> dict[str, float]:
    return {shortfall.part: shortfall.stops for shortfall in plan.shortfalls}


def test_the_slowest_shutter_costs_the_dark_end_and_its_stops_are_said():
    target = scene(SENSORS[0], 10.0)
    free = plan_bracket([target], listed(), BracketGoals())
    longest = free.exposures[-1].time
    for stops in (1, 3, 5):
        wanted = BracketGoals(slowest=longest / 2.0**stops)
        plan = plan_bracket([target], listed(wanted=wanted), wanted)
        assert max(e.time for e in plan.exposures) <= wanted.slowest * 1.001
        # The free plan had up to a third of a stop to spare.
        assert stops - 0.34 < shortfalls(plan)["dark"] <= stops
        assert set(shortfalls(plan)) == {"dark"}


def test_a_total_time_is_kept_with_the_least_loss():
    target = scene(SENSORS[0], 14.0)
    exposures = listed()
    free = plan_bracket([target], exposures, BracketGoals())
    assert plan_bracket([target], exposures, BracketGoals(total=free.total)) == free
    wanted = BracketGoals(total=free.total / 10)
    plan = plan_bracket([target], exposures, wanted)
    assert plan.total <= wanted.total
    assert shortfalls(plan)["dark"] == pytest.approx(math.log2(10), abs=0.7)
    with pytest.raises(CaptureError, match="no bracket fits into 1e-05 s"):
        plan_bracket([target], exposures, BracketGoals(total=1e-5))


def test_iso_is_raised_only_where_time_has_run_out_and_never_over_its_limit():
    isos = (100.0, 200.0, 400.0, 800.0)
    target = scene(SENSORS[1], 0.0)
    wanted = BracketGoals()
    needed = plan_bracket([target], listed(isos=isos), wanted).exposures[0]
    assert needed.iso == 100
    # At ISO 100 this sensor rounds to steps of 8 electrons, beside 7 of read noise: ISO helps a little.
    wanted = BracketGoals(slowest=needed.time / 2 ** (1 / 3))
    raised = plan_bracket([target], listed(isos=isos, wanted=wanted), wanted)
    limited = BracketGoals(slowest=wanted.slowest, highest_iso=250)
    held = plan_bracket([target], listed(isos=isos, wanted=limited), limited)
    assert raised.exposures[0].iso > 100
    assert {e.iso for e in held.exposures} <= {100.0, 200.0}
    with pytest.raises(InputError, match="no ISO is 50 or lower: the lowest is 100"):
        listed(isos=isos, wanted=BracketGoals(highest_iso=50))
    with pytest.raises(InputError, match=r"no exposure is .* or shorter"):
        listed(wanted=BracketGoals(slowest=1e-6))


def test_an_iso_that_shows_hardly_more_is_left_alone():
    """8 bits round a well of 10,000 electrons to steps of 39: ISO 400 shows much more, ISO 1600 little."""
    coarse = RawNoise(SensorNoise(gain=255 / 10_000, read_noise=3.0), 255.0)
    isos = (100.0, 400.0, 1600.0)
    exposures = listed(isos=isos)
    assert {e.iso for e in without_idle_isos([scene(coarse, 4.0)], exposures, 20.0)} == {100.0, 400.0}
    assert {e.iso for e in without_idle_isos([scene(SENSORS[0], 4.0)], exposures, 20.0)} == {100.0}


def test_light_beyond_the_list_is_said():
    target = scene(SENSORS[0], 4.0, dark=2.0**20)
    fastest = listed()[0]
    plan = plan_bracket([target], listed(), BracketGoals())
    assert plan.exposures == (fastest,)
    over = math.log2(target.bright * 2**SLACK / SENSORS[0].brightest(fastest))
    assert shortfalls(plan) == {"bright": pytest.approx(over)}
    assert "clips by" in str(plan.shortfalls[0])


def test_a_hole_in_the_list_is_said():
    plan = plan_bracket([scene(SENSORS[0], 14.0, dark=0.05)], listed(times=(2.0**-8, 2.0**4)), BracketGoals())
    assert len(plan.exposures) == 2
    assert shortfalls(plan)["middle"] == pytest.approx(12.0 - stops_of(SENSORS[0], 20.0))


def test_many_small_gaps_are_told_in_one_sentence():
    """At 38 dB this sensor is good for less than the 1/3 stop between its shutter times."""
    plan = plan_bracket([scene(SENSORS[0], 2.0)], listed(), BracketGoals(snr=37.9))
    assert len(plan.exposures) > 3
    (gaps,) = (shortfall for shortfall in plan.shortfalls if shortfall.part == "middle")
    assert str(gaps).endswith("stops between exposures are in none")


def test_a_camera_with_one_exposure_time_has_one_exposure_and_hears_what_it_misses():
    lone = listed(times=(1 / 64,))
    middle = SENSORS[0].brightest(lone[0])
    inside = Target("cam0", "G", SENSORS[0], middle / 2**5, middle / 2)
    assert plan_bracket([inside], lone, BracketGoals()) == BracketPlan(lone, ())
    wide = plan_bracket([Target("cam0", "G", SENSORS[0], middle / 2**9, middle * 4)], lone, BracketGoals())
    assert wide.exposures == lone
    assert shortfalls(wide) == {
        "dark": pytest.approx(9 - SLACK - stops_of(SENSORS[0], 20.0), abs=1e-6),
        "bright": pytest.approx(2 + SLACK),
    }


def test_an_snr_that_the_sensor_never_reaches_is_refused():
    with pytest.raises(CaptureError, match=r"50 dB are out of .* cam0, which gives 3\d\.\d dB"):
        plan_bracket([scene(SENSORS[0], 4.0)], listed(), BracketGoals(snr=50.0))


def test_an_end_that_the_meter_did_not_find_is_never_called_covered():
    target = Target("cam0", "R", SENSORS[0], 4.0, 8.0, no_darker=False, no_brighter=False)
    parts = {s.part: str(s) for s in plan_bracket([target], listed(), BracketGoals()).shortfalls}
    assert parts == {
        "dark": "cam0 R: the meter found no dark end",
        "bright": "cam0 R: the meter found no bright end",
    }


@pytest.mark.parametrize(
    ("stops", "at_least", "words"),
    [
        (1.26, False, "lacks 1.3 stops"),
        (1.26, True, "lacks at least 1.3 stops"),
        (0.01, False, "lacks less than 0.1 stops"),
        (0.01, True, "the meter found no dark end"),
    ],
)
def test_a_shortfall_says_no_more_than_is_known(stops, at_least, words):
    assert words in str(Shortfall("cam0 G", "dark", stops, at_least))


def test_a_rig_has_what_all_its_cameras_have():
    one = Capabilities(8, 8, 12, (1 / 60, 1 / 30, 1 / 15), (4.0,), (100.0, 200.0))
    other = Capabilities(8, 8, 12, (1 / 64, 1 / 32), (4.0,), (200.0, 400.0))
    assert common_times([one, other]) == (1 / 60, 1 / 30)
    assert common_isos([one, other]) == (200.0,)
    with pytest.raises(CaptureError, match="no shutter time in common"):
        common_times([one, Capabilities(8, 8, 12, (8.0,), (4.0,), ())])


@pytest.mark.parametrize("number", range(3))
def test_scenes_before_real_sensors_get_as_few_exposures_as_brute_force(number):
    """Some scenes of bench/capture/planner.py: every time at every ISO, all subsets by increasing size."""
    sensor = list(cases.SENSORS.values())[number]
    rng = np.random.default_rng([7, number])
    sizes = set()
    for _ in range(12):
        case = cases.draw(sensor, rng)
        plan = plan_bracket(case.targets, listed(case.times, case.isos), BracketGoals(snr=case.snr))
        needed = cases.demands(case, case.shots)
        chosen = sum(1 << case.shots.index(shot) for shot in plan.exposures)
        assert ((needed & np.uint32(chosen)) != 0).all()
        best = cases.fewest(needed, len(case.shots))
        assert len(plan.exposures) == best
        sizes.add(best)
    assert len(sizes) > 1
