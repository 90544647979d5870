"""Files with a few wrong bytes."""

from hypothesis import strategies as st


def damaged(data: bytes, head: int, most: int = 5) -> st.SearchStrategy[bytes]:
    """Copies of a file with up to `most` wrong bytes, about half of them in its first `head` bytes."""

    def wrong(changes: list[tuple[int, int]]) -> bytes:
        copy = bytearray(data)
        for position, value in changes:
            copy[position if value % 2 else position % head] = value
        return bytes(copy)

    place = st.tuples(st.integers(0, len(data) - 1), st.integers(0, 255))
    return st.lists(place, min_size=1, max_size=most).map(wrong)
