"""Every line of docs/extremes.md names tests that are there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LINES = re.split(r"^\* ", (ROOT / "docs" / "extremes.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")


@pytest.mark.parametrize("line", LINES, ids=lambda line: re.sub(r"\W+", " ", line)[:50].strip())
def test_a_claim_has_its_test(line: str) -> None:
    named = TEST.findall(line)
    assert named or "bench/" in line
    for path, name in named:
        assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), f"{path} has no {name}"


def test_lines_are_found() -> None:
    assert len(LINES) > 30
