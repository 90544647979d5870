"""report.html of a reconstruction: views go by the names that the user gave their photographs."""

import json
from pathlib import Path

from imaging.session.paths import find_reconstruction
from rig.report.pages.reconstruction import reconstruction_report
from tests.rig.report.pages import Page


def test_views_of_an_import_have_the_names_of_their_photographs(scene: Path) -> None:
    folder = find_reconstruction(scene)
    page = Page.read(reconstruction_report(folder))
    assert "frame 0 (" not in page.text
    shots = scene / "shots.jsonl"
    records = [json.loads(line) for line in shots.read_text().splitlines()]
    for record in records:
        record["source"] = f"/home/me/{record['camera']}/IMG_{record['frame']:02d}{record['step']}.CR3"
    shots.write_text("".join(f"{json.dumps(record)}\n" for record in records))
    page = Page.read(reconstruction_report(folder))
    (held_out,) = {view["view"] for view in json.loads((folder / "metrics.json").read_text())["views"]}
    frame, camera = held_out.split("/")
    name = f"IMG_{int(frame):02d}0.CR3"
    assert f"{held_out} ({name})" in page.text  # in the table of metrics
    assert f"Camera {camera}, frame {int(frame)} ({name})" in page.text  # above its pictures
    assert f"{camera} · frame {int(frame)} ({name})" in page.text  # on the contact sheet
