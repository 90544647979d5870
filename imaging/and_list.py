"""Words in a row as English has them."""

from collections.abc import Iterable


def and_list(words: Iterable[str]) -> str:
    """Return `a`, `a and b`, or `a, b and c`; empty without any."""
    *before, last = [*words] or [""]
    return f"{', '.join(before)} and {last}" if before else last
