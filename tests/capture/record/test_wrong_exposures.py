"""Frames whose exposure is another than asked for: taken again, recorded as they are, and named."""

from dataclasses import replace

from capture.record import recorder
from imaging.errors import CameraError
from imaging.files import store
from imaging.optics.exposure import Exposure

from .test_recorder import run


def by_step(session):
    return {shot.step: shot for shot in session.shots() if shot.frame == 0}


def test_a_frame_of_another_exposure_is_taken_again_and_accepted_when_it_agrees(fake_rig):
    rig = fake_rig(a="raw")
    rig.cameras["a"].faults["collect", 2] = rig.plan.bracket[0]  # the frame before, as real cameras do
    result = run(rig)
    shots = by_step(rig.session)
    assert result.problems == ()
    assert shots[1].reported == rig.plan.bracket[1]
    assert [shots[step].retries for step in range(3)] == [0, 1, 0]
    assert store.sha256(rig.session.file(shots[1])) == shots[1].sha256


def test_a_camera_that_stays_wrong_is_recorded_as_it_reports_and_listed(fake_rig):
    rig = fake_rig(a="raw")
    wrong = Exposure(time=1 / 25, iso=100)
    rig.cameras["a"].faults |= {("collect", 2): wrong, ("collect", 4): wrong}
    result = run(rig)
    shot = by_step(rig.session)[1]
    assert (shot.requested, shot.reported, shot.retries) == (rig.plan.bracket[1], wrong, 1)
    assert result.missing == ()
    assert result.problems == (
        "a, frame 0, step 1: the camera reports 1/25 s ISO 100 "
        "where 1/32 s ISO 100 was asked for (+0.36 stops)",
    )
    assert rig.cameras["a"].calls.count("collect") == 10


def test_a_camera_that_is_wrong_in_several_shots_is_one_sentence(fake_rig):
    rig = fake_rig(a="raw")
    wrong = Exposure(time=1 / 25, iso=100)
    rig.cameras["a"].faults |= {("collect", call): wrong for call in range(1, 7)}
    (problem,) = run(rig).problems
    assert problem == (
        "a: 3 shots report another exposure than was asked for, such as frame 0, step 2: "
        "1/25 s ISO 100 where 1/128 s ISO 100 was asked for (+2.36 stops)"
    )


def test_a_wrong_frame_is_kept_where_the_camera_then_fails(fake_rig):
    rig = fake_rig(a="raw")
    wrong = Exposure(time=1 / 25, iso=100)
    gone = CameraError("camera serial-a is gone.")
    rig.cameras["a"].faults |= {("collect", 2): wrong} | {("collect", call): gone for call in (4, 5, 6, 7)}
    result = run(rig)
    shot = by_step(rig.session)[1]
    assert (shot.reported, shot.retries, result.missing) == (wrong, 0, ())
    assert store.sha256(rig.session.file(shot)) == shot.sha256


def test_a_wrong_frame_is_kept_where_further_attempts_are_damaged(fake_rig):
    rig = fake_rig(a="ldr")
    wrong = Exposure(time=1 / 25, iso=100)
    rig.cameras["a"].faults["collect", 2] = wrong
    collect = rig.cameras["a"].collect

    def cut_off():
        frame = collect()
        again = rig.cameras["a"].calls.count("collect") in (4, 5)
        return replace(frame, data=frame.data[:400]) if again else frame

    rig.cameras["a"].collect = cut_off
    result = run(rig)
    shot = by_step(rig.session)[1]
    assert (shot.reported, shot.retries, result.missing) == (wrong, 0, ())
    assert store.sha256(rig.session.file(shot)) == shot.sha256
    assert recorder.leftovers(rig.session) == []


def test_a_wrong_frame_leaves_nothing_where_a_better_one_follows(fake_rig):
    rig = fake_rig(a="ldr")
    rig.cameras["a"].faults["collect", 2] = rig.plan.bracket[0]
    run(rig)
    assert by_step(rig.session)[1].reported == rig.plan.bracket[1]
    assert recorder.leftovers(rig.session) == []


def test_a_sixth_of_a_stop_is_rounding_and_more_is_not(fake_rig):
    for stops, problems in ((0.16, 0), (-0.16, 0), (0.17, 1), (-0.17, 1)):
        rig = fake_rig(f"session{stops}", a="raw")
        off = Exposure(time=2.0**stops / 8, iso=100)
        rig.cameras["a"].faults |= {("collect", 1): off, ("collect", 4): off}
        assert len(run(rig).problems) == problems


def test_a_setting_that_reads_back_wrong_is_set_again(fake_rig):
    rig = fake_rig(a="raw")
    rig.cameras["a"].faults["set_exposure", 1] = Exposure(time=1.0, iso=100)
    result = run(rig)
    assert result.problems == ()
    assert rig.cameras["a"].calls[:3] == ["set_exposure", "set_exposure", "arm"]
    assert rig.session.shots()[0].retries == 0
