"""The progress line: what it says, when it is printed, and that it never lies about the time left."""

import io
from dataclasses import dataclass

import pytest

from rig.terminal.live_line import live_status_line
from rig.terminal.progress import PlainStatusLine, status_line
from rig.terminal.stage import Stage


@dataclass
class FakeClock:
    now: float = 100.0

    def __call__(self) -> float:
        return self.now


def begun(name: str) -> tuple[Stage, FakeClock]:
    clock = FakeClock()
    stage = Stage(clock)
    stage.begin(name)
    return stage, clock


def status() -> tuple[PlainStatusLine, FakeClock, io.StringIO]:
    clock, stream = FakeClock(), io.StringIO()
    return PlainStatusLine(stream, clock), clock, stream


def test_time_left_is_the_pace_so_far_applied_to_the_rest() -> None:
    stage, clock = begun("train")
    stage.move("iterations", 0, 100)
    clock.now += 10
    stage.move("iterations", 25, 100)
    assert stage.remaining() == pytest.approx(30)
    assert stage.line() == "train: iterations, 25/100, 10 s, 30 s left"


def test_a_resumed_stage_does_not_count_what_was_there_before() -> None:
    stage, clock = begun("train")
    stage.move("iterations", 90, 100)
    assert stage.remaining() is None
    clock.now += 10
    stage.move("iterations", 92, 100)
    assert stage.remaining() == pytest.approx(40)


def test_a_new_part_starts_a_new_pace() -> None:
    stage, clock = begun("calibrate")
    stage.move("keypoints", 0, 10)
    clock.now += 100
    stage.move("keypoints", 10, 10)
    stage.move("pairs", 0, 40)
    clock.now += 2
    stage.move("pairs", 20, 40)
    assert stage.remaining() == pytest.approx(2)
    assert stage.elapsed() == pytest.approx(102)


def test_the_time_left_falls_while_the_next_report_is_under_way() -> None:
    stage, clock = begun("train")
    stage.move("iterations", 0, 10)
    clock.now += 10
    stage.move("iterations", 5, 10)
    remaining = []
    for _ in range(3):
        remaining.append(stage.remaining())
        clock.now += 4
    assert remaining == pytest.approx([10, 6, 2])
    clock.now += 4
    assert stage.remaining() == 0


def test_an_unknown_length_has_no_count_and_no_time_left() -> None:
    stage, clock = begun("calibrate")
    clock.now += 70
    stage.move("bundle adjustment", 3, 0)
    assert stage.remaining() is None
    assert stage.line() == "calibrate: bundle adjustment, 1 min 10 s"


def test_plain_lines_come_after_a_second_and_then_every_five() -> None:
    progress, clock, stream = status()
    progress.begin("check")
    for file in range(64):  # 16 seconds of a busy stage
        progress("reading", file, 64)
        clock.now += 0.25
    assert stream.getvalue().splitlines() == [
        "check: reading, 4/64, 1.0 s, 15 s left",
        "check: reading, 24/64, 6.0 s, 10 s left",
        "check: reading, 44/64, 11 s, 5.0 s left",
    ]


def test_a_silent_stage_still_shows_that_it_lives() -> None:
    progress, clock, stream = status()
    progress.begin("calibrate")
    for _ in range(13):
        clock.now += 1
        progress.tick()
    assert [line.split(", ")[-1] for line in stream.getvalue().splitlines()] == ["1.0 s", "6.0 s", "11 s"]


def test_a_stage_that_fails_at_once_prints_no_progress() -> None:
    progress, _, stream = status()
    progress.begin("check")
    progress("reading", 0, 5)
    assert stream.getvalue() == ""


def test_file_names_cannot_move_the_cursor() -> None:
    progress, clock, stream = status()
    progress.begin("check")
    clock.now += 1
    progress("reading \x1b[2Jx\ny", 0, 0)
    assert stream.getvalue() == "check: reading \\x1b[2Jx\\ny, 1.0 s\n"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_the_line_is_drawn_without_markup() -> None:
    stream = Terminal()
    with live_status_line(stream) as live:
        live.begin("check")
        live("reading [red]x[/red] \x1b]0;pwned\x07", 2, 8)
        live.progress.refresh()
        live.say("kept [b]line[/b]")
    text = stream.getvalue()
    assert "check" in text
    assert "reading [red]x[/red]" in text
    assert "2/8" in text
    assert "\x1b]0;" not in text
    assert "kept [b]line[/b]" in text


@pytest.mark.parametrize("width", [80, 100, 160])
def test_the_figure_of_a_training_is_seen_however_narrow_the_terminal(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.setenv("TERM", "xterm")
    stream = Terminal()
    with live_status_line(stream) as live:
        live.begin("reconstruct")
        live("held-out 41.3 dB, loss 0.0312, 21.3 it/s", 1000, 2000)
        live.stage.began -= 75
        live.stage.pace_from = (live.stage.began, 0)
        live.progress.refresh()
    assert "held-out 41.3 dB" in stream.getvalue()
    assert "1 min 15 s left" in stream.getvalue()


def test_the_kind_of_stream_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    with status_line(Terminal()) as live:
        assert not isinstance(live, PlainStatusLine)
    monkeypatch.setenv("TERM", "dumb")
    with status_line(Terminal()) as dumb:
        assert isinstance(dumb, PlainStatusLine)
    with status_line(io.StringIO()) as plain:
        assert isinstance(plain, PlainStatusLine)


def test_words() -> None:
    from rig.terminal.text import counted, duration, number, sentence, size

    assert [duration(s) for s in (0, 0.04, 9.94, 9.96, 59.4, 59.6, 125, 3599.6, 7260)] == [
        "0.0 s",
        "0.0 s",
        "9.9 s",
        "10 s",
        "59 s",
        "1 min 00 s",
        "2 min 05 s",
        "1 h 00 min",
        "2 h 01 min",
    ]
    assert [size(n) for n in (0, 999, 1000, 3_200_000)] == ["0 B", "999 B", "1 kB", "3.2 MB"]
    assert [size(n) for n in (999_499, 999_500, 1_240_000_000)] == ["999 kB", "1 MB", "1.24 GB"]
    assert [number(v) for v in (0.0, 0.2104, 39.7, 12345.0, float("nan"), None)] == [
        "0",
        "0.210",
        "39.7",
        "12,345",
        "n/a",
        "n/a",
    ]
    assert (counted(1, "shot"), counted(0, "shot"), counted(2, "rig")) == ("1 shot", "0 shots", "2 rigs")
    assert (sentence(" done "), sentence("done.")) == ("done.", "done.")
