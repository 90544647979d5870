"""Calls in processes of their own: the same answers in the same order, whatever becomes of a process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from imaging.compute.processes import in_processes
from imaging.errors import InputError
from tests.imaging.compute.calls import KeptError, NamedError, half, killed_there, marked, raising, unsendable


@pytest.mark.parametrize("count", [1, 2, 3])
def test_answers_come_in_order_from_so_many_processes(count: int) -> None:
    answers = list(in_processes(count, half, [(2 * number,) for number in range(9)]))
    assert [answer for answer, _ in answers] == list(range(9))
    who = {process for _, process in answers}
    assert len(who) <= count
    assert (os.getpid() in who) == (count == 1)


def test_nothing_asked_begins_nothing() -> None:
    assert list(in_processes(2, half, [])) == []


@pytest.mark.parametrize("count", [1, 2])
def test_an_error_is_raised_in_its_turn(count: int) -> None:
    answers = in_processes(count, half, [(2,), (4,), (5,), (6,)])
    assert [next(answers)[0], next(answers)[0]] == [1, 2]
    with pytest.raises(InputError, match="5 is odd: name an even number"):
        next(answers)


def test_what_a_killed_process_was_at_is_done_here() -> None:
    asked = [(number, os.getpid()) for number in range(5)]
    assert list(in_processes(2, killed_there, asked)) == [0, 2, 4, 6, 8]


def test_what_cannot_be_sent_is_found_here() -> None:
    (function,) = in_processes(2, unsendable, [(7,)])
    assert callable(function)
    assert function() == 7


@pytest.mark.parametrize(("kind", "error"), [("kept", KeptError), ("named", NamedError)])
def test_an_error_that_cannot_be_sent_is_raised_as_it_is(
    kind: str, error: type[Exception], capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(error, match="7 is odd"):
        list(in_processes(2, raising, [(kind, 7)]))
    assert capfd.readouterr().err == ""


def test_who_ends_early_waits_for_no_more(tmp_path: Path) -> None:
    answers = in_processes(2, marked, [(tmp_path, number) for number in range(100)])
    assert next(answers) == 0
    answers.close()  # type: ignore[attr-defined]
    assert len(list(tmp_path.iterdir())) <= 6  # the first, four ahead of it, and one that took its place


def test_a_program_of_a_few_lines_does_not_begin_anew(tmp_path: Path) -> None:
    """It has no `if __name__ == "__main__"`, and its own modules hide none of ours in the processes."""
    program = tmp_path / "program.py"
    program.write_text(
        "print('begun')\n"
        "from math import hypot\n"
        "from imaging.compute.processes import in_processes\n"
        "print(list(in_processes(2, hypot, [(3, 4), (5, 12)])))\n"
    )
    (tmp_path / "imaging").mkdir()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run(
        [sys.executable, "-P", program],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
        timeout=60,
    )
    assert (done.stdout, done.stderr) == ("begun\n[5.0, 13.0]\n", "")
