"""The page of a batch says at which width its figures hold, since those of several are not to be compared."""

import re
from pathlib import Path

import pytest

from rig.batch.result import BatchResult, BatchRow
from rig.report.pages.batch import batch_report


@pytest.mark.parametrize(
    ("widths", "said"),
    [((640, 640), "held out, at 640 px"), ((640, 320), "held out, at 320 to 640 px: not to be compared")],
)
def test_decibels_of_several_widths_are_not_put_side_by_side_in_silence(tmp_path: Path, widths, said) -> None:
    rows = tuple(
        BatchRow.model_construct(**{
            "session": tmp_path / str(number), "scene": "one", "db": 20.0 + number, "width": width,
            "seconds": 1.0, "already_there": False, "exports": (), "says": None, "failed": None,
            "report": None, "iterations": None, "forecast": None, "peak": None, "processor_seconds": None,
        })
        for number, width in enumerate(widths)
    )  # fmt: skip
    page = batch_report(
        BatchResult.model_construct(plan=tmp_path / "plan.toml", rows=rows, shard=None)
    ).read_text()
    assert said in re.sub(r"\s+", " ", page)
