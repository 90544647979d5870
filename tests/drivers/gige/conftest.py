"""Rows of simulated cameras that go when a test is over."""

from collections.abc import Iterator

import pytest

from .rows import MakeRow, rows


@pytest.fixture
def make_row() -> Iterator[MakeRow]:
    with rows() as make:
        yield make
