"""The page of a batch says at which width its figures hold, since those of several are not to be compared."""

import re
from pathlib import Path

import pytest

from rig.batch.result import BatchResult, BatchRow
from rig.report.pages.batch import batch_report
from tests.rig.report.pages import Page


def row(session: Path, **values: object) -> BatchRow:
    return BatchRow.model_construct(**{
        "session": session, "scene": "one", "db": 20.0, "width": 640, "seconds": 1.0, "already_there": False,
        "exports": (), "says": None, "failed": None, "report": None, "iterations": None, "forecast": None,
        "peak": None, "processor_seconds": None,
    } | values)  # fmt: skip


def written(folder: Path, *rows: BatchRow) -> str:
    result = BatchResult.model_construct(plan=folder / "plan.toml", rows=rows, shard=None)
    return batch_report(result).read_text()


def test_links_lead_to_reports_in_folders_of_any_name(tmp_path: Path) -> None:
    report = tmp_path / "a b#1 50%20?" / "report.html"
    page = written(tmp_path, row(report.parent, report=report))
    (link,) = [
        attributes["href"] for attributes in Page(page).all("a") if "report" in str(attributes["href"])
    ]
    assert link == "a%20b%231%2050%2520%3F/report.html"


@pytest.mark.parametrize(
    ("widths", "said"),
    [((640, 640), "held out, at 640 px"), ((640, 320), "held out, at 320 to 640 px: not to be compared")],
)
def test_decibels_of_several_widths_are_not_put_side_by_side_in_silence(tmp_path: Path, widths, said) -> None:
    rows = (row(tmp_path / str(number), db=20.0 + number, width=width) for number, width in enumerate(widths))
    page = written(tmp_path, *rows)
    assert said in re.sub(r"\s+", " ", page)
