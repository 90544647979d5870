"""Silence inside, nothing lost outside."""

import ctypes
import os
import subprocess
import sys
import threading

import pytest

from imaging.files.silence import quiet


def chatter() -> None:
    ctypes.CDLL(None).puts(b"native")
    os.write(1, b"descriptor 1\n")
    os.write(2, b"descriptor 2\n")
    print("python")


def test_nothing_inside_is_seen_and_all_outside_is(capfd: pytest.CaptureFixture[str]) -> None:
    print("before")
    with quiet():
        chatter()
    print("after")
    assert capfd.readouterr() == ("before\nafter\n", "")


def test_an_error_inside_ends_the_silence(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(RuntimeError), quiet():
        raise RuntimeError
    chatter()
    out, err = capfd.readouterr()
    assert {"descriptor 1", "python"} <= set(out.split("\n"))
    assert err == "descriptor 2\n"


def test_blocks_of_threads_may_overlap(capfd: pytest.CaptureFixture[str]) -> None:
    first_inside, second_inside = threading.Event(), threading.Event()

    def first() -> None:
        with quiet():
            first_inside.set()
            second_inside.wait(10)

    def second() -> None:
        first_inside.wait(10)
        with quiet():
            second_inside.set()
            threads[0].join(10)
            chatter()

    threads = [threading.Thread(target=first), threading.Thread(target=second)]
    descriptors = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else 0
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    if descriptors:
        assert len(os.listdir("/proc/self/fd")) == descriptors
    print("after")
    assert capfd.readouterr() == ("after\n", "")


@pytest.mark.parametrize("closing", ["os.close(1)", "os.close(2)", "sys.stdout = None", "sys.stderr = None"])
def test_closed_streams_are_no_obstacle(closing: str) -> None:
    program = (
        f"import os, sys\nfrom imaging.files.silence import quiet\n{closing}\nwith quiet(): pass\nos._exit(7)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (7, b"", b"")
