"""rig beside OpenSplat: nothing of an earlier background or schedule is taken for a row."""

import argparse
from pathlib import Path

from bench.peers import compare, opensplat
from bench.support.trial import Cache


def test_photographs_are_written_anew_over_another_background(tmp_path, monkeypatch):
    written = []

    def write(dataset, folder):
        written.append(opensplat.BACKGROUND)
        folder.mkdir()
        (folder / "transforms.json").touch()

    monkeypatch.setattr(compare, "load", lambda session, max_width: None)
    monkeypatch.setattr(compare, "_write_folder", write)
    monkeypatch.setattr(opensplat, "VARIANTS", ())
    magenta, black = (0.613, 0.0101, 0.3984), (0.0, 0.0, 0.0)
    for background in (magenta, black, black):
        monkeypatch.setattr(opensplat, "BACKGROUND", background)
        compare.peer_rows(Path("lego-session"), 400, 120.0, Path("build/opensplat"), tmp_path, 0)
    assert written == [magenta, black]


def test_rows_of_opensplat_are_of_the_runs_that_are_valid_now(tmp_path, monkeypatch):
    Cache(tmp_path / "real.jsonl").get("OpenSplat build castle 400 120 0", lambda: [{"gained": 1.0}])
    monkeypatch.setattr(opensplat, "built", lambda work, checkout: Path("build/opensplat"))
    monkeypatch.setattr(opensplat, "version", lambda program: "1.2.0")
    monkeypatch.setattr(compare, "session_of", lambda name, work: Path(name))
    monkeypatch.setattr(compare, "rig_row", lambda *rest: {"gained": 3.0})
    monkeypatch.setattr(compare, "peer_rows", lambda *rest: [{"gained": 2.0}])
    options = argparse.Namespace(
        work=tmp_path, opensplat=None, sets="castle", budgets="120", width=400, seeds=1, unseen=False
    )
    (row,) = compare.measure(options)["rows"]
    assert row["OpenSplat"] == {"gained": 2.0}
