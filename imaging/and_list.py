"""Words in a row as English has them."""

from collections.abc import Iterable, Sequence


def and_list(words: Iterable[str]) -> str:
    """Return `a`, `a and b`, or `a, b and c`; empty without any."""
    *before, last = [*words] or [""]
    return f"{', '.join(before)} and {last}" if before else last


def and_more(names: Sequence[str], most: int) -> str:
    """Return `a, b and 3 more`: the first `most` names and the number of the others."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
