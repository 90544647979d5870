"""Start time of the command."""

import subprocess
import sys
import time

from rig.terminal.start_time import process_age, set_start, started_at


def test_the_age_of_a_process_counts_what_it_did_before_it_was_asked() -> None:
    code = (
        "import time; time.sleep(0.3); from rig.terminal.start_time import process_age; print(process_age())"
    )
    began = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 0.3 <= float(done.stdout) <= time.monotonic() - began + 0.05


def test_a_command_within_a_process_counts_from_now() -> None:
    before = time.monotonic()
    set_start(process=False)
    assert before <= started_at() <= time.monotonic()
    assert process_age() > 0
    set_start(process=True)
    assert started_at() < before
    set_start(process=False)
