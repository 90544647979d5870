"""Assignment of an import's photographs to brackets."""

import pytest

from capture.imports.photos import import_photos
from imaging.session.session import Session, brackets

from .photo_files import T, jpeg, put


def shoot(tmp_path, times, gap=1.0, **said) -> dict[str, bytes]:
    """A series with a clock that runs; None in `times` is a pause of two minutes."""
    files, at = {}, 0.0
    for time in times:
        at += gap if time is not None else 120.0
        if time is not None:
            files[f"{len(files):03d}.jpg"] = jpeg(len(files), time=time, at=at, **said)
    return put(tmp_path / "photos", files)


def frames_of(tmp_path, **options) -> list[int]:
    """Lengths of the brackets in order of frames."""
    import_photos(tmp_path / "photos", tmp_path / "s", **options)
    return [len(group) for group in brackets(Session.open(tmp_path / "s").shots()).values()]


GUESSES = {
    "three by three": ([T, T / 4, 4 * T] * 3, [3, 3, 3]),
    "three by three, moved by auto exposure": (
        [T, T / 4, 4 * T, 1.5 * T, 1.5 * T / 4, 6 * T, T / 1.7, T / 6.8, 4 * T / 1.7],
        [3, 3, 3],
    ),
    "one series by hand": ([2.0, 0.5, 1 / 8, 1 / 30, 1 / 125, 1 / 1000], [6]),
    "one camera bracket": ([T, T / 4, 4 * T], [3]),
    "the same exposure": ([T] * 6, [1] * 6),
    "auto exposure that wanders": ([T, T / 1.3, T * 1.2, T, T / 1.6, T * 1.1], [1] * 6),
    "two photos": ([T, T / 4], [1, 1]),
    "pairs, three times": ([T, T / 8] * 3, [2, 2, 2]),
    "brackets, then singles after a pause": ([T, T / 4, 4 * T, None, T, T, T, T], [3, 1, 1, 1, 1]),
    "a third of a stop is no bracket": ([T, T / 1.26, T * 1.26] * 2, [1] * 6),
    "one bracket is incomplete": ([T, T / 4, 4 * T, T, T / 4, 4 * T, T, T / 4], [1] * 8),
}


@pytest.mark.parametrize("name", GUESSES)
def test_brackets_are_guessed_from_exposure_and_time(tmp_path, name):
    times, lengths = GUESSES[name]
    shoot(tmp_path, times)
    assert frames_of(tmp_path) == lengths


def test_a_pause_within_a_bracket_makes_single_frames(tmp_path):
    shoot(tmp_path, [T, None, T / 4, None, 4 * T])
    assert frames_of(tmp_path) == [1, 1, 1]


def test_another_aperture_is_no_bracket(tmp_path):
    put(
        tmp_path / "photos",
        {f"{n}.jpg": jpeg(n, time=T, at=n, f_number=f) for n, f in enumerate((2.8, 5.6, 11.0))},
    )
    assert frames_of(tmp_path) == [1, 1, 1]


def test_a_bracket_that_is_given_wins_over_the_guess(tmp_path):
    shoot(tmp_path, [T, T / 4, 4 * T] * 3)
    assert frames_of(tmp_path, bracket=2) == [2, 2, 2, 2, 1]
    session = Session.open(tmp_path / "s")
    plans = {len(plan.bracket): plan for plan in session.plans()}
    assert plans[2].frames == (0, 1, 2, 3)
    assert plans[1].frames == (4,)
    assert plans[2].bracket == (None, None)  # the frames do not agree


def test_the_plan_states_the_exposures_that_all_frames_share(tmp_path):
    shoot(tmp_path, [T, T / 4, 4 * T] * 3)
    result = import_photos(tmp_path / "photos", tmp_path / "s")
    (plan,) = Session.open(tmp_path / "s").plans()
    assert [exposure.time for exposure in plan.bracket] == pytest.approx([T, T / 4, 4 * T], rel=1e-3)
    assert plan.frames == (0, 1, 2)
    assert "3 brackets of 3" in result.guesses[-1]
    assert plan.reason == result.guesses[-1]
