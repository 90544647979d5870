"""The share of the cores that is left, where it is known: threads that have to share one core."""

import os
import sys

import pytest

from imaging.compute.free_share import free_share


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux pins a process to a core")
def test_threads_that_share_a_core_have_their_part_of_it() -> None:
    """At most, since other work takes its own part."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        shares = [free_share(threads) for threads in (1, 2, 4)]
    finally:
        os.sched_setaffinity(0, before)
    assert all(0 < share <= 1 for share in shares)
    assert shares[1] < 0.55
    assert shares[2] < 0.3
