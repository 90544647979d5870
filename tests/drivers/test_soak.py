"""Twenty cycles of bench/capture/soak.py, which runs a thousand."""

from bench.capture.soak import soak


def test_opening_and_closing_piles_nothing_up() -> None:
    run = soak(20)
    assert run["descriptors_added"] <= 0
    assert run["objects_added"] < 10  # less than one a cycle, of which twenty took place
    assert run["handles_open"] == 0
