"""Words in a row."""

import pytest

from imaging.and_list import and_list


@pytest.mark.parametrize(
    ("words", "said"),
    [("", ""), ("a", "a"), ("ab", "a and b"), ("abcd", "a, b, c and d")],
)
def test_the_last_two_have_an_and_between_them(words: str, said: str) -> None:
    assert and_list(iter(words)) == said
