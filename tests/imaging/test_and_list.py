"""Words in a row."""

import pytest

from imaging.and_list import and_list, and_more


@pytest.mark.parametrize(
    ("words", "said"),
    [("", ""), ("a", "a"), ("ab", "a and b"), ("abcd", "a, b, c and d")],
)
def test_the_last_two_have_an_and_between_them(words: str, said: str) -> None:
    assert and_list(iter(words)) == said


@pytest.mark.parametrize(("names", "said"), [("", ""), ("ab", "a, b"), ("abcd", "a, b and 2 more")])
def test_names_beyond_the_most_are_counted(names: str, said: str) -> None:
    assert and_more(names, 2) == said
