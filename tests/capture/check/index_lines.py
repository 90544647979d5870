"""The lines of shots.jsonl as tests damage them, and what a check says of it."""

import json

from capture.check.check import CheckReport
from imaging.session.session import Session


def lines(session: Session) -> list[dict]:
    return [json.loads(line) for line in (session.folder / "shots.jsonl").read_text().splitlines()]


def write(session: Session, records: list[dict]) -> None:
    text = "".join(json.dumps(one) + "\n" for one in records)
    (session.folder / "shots.jsonl").write_text(text)


def kinds(report: CheckReport) -> list[str]:
    return [problem.kind for problem in report.problems]
