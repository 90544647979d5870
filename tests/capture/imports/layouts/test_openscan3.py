"""OpenScan3's projects, in folders of its layout: the angles of the table, stacks, and damaged records."""

import json
from pathlib import Path

import pytest

from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.session.session import Session

STOPS = 6


def project(folder: Path, picture, put, thetas=(60.0, 90.0), *, tilt=0.0, stacked=False) -> Path:
    """Write a project with scans; tilt: degrees by which the rotor moves from a stop to the next."""
    scans = {}
    for index, theta in enumerate(thetas, 1):
        scan = folder / f"scan{index:02d}"
        names = []
        for step in range(STOPS):
            stem = f"scan{index:02d}_{step:03d}"
            inner = [f"{stem}_fs01", f"{stem}_fs02"] if stacked else [stem]
            for name in inner:
                put(scan / f"{name}.jpg", picture(10 * index + step))
                polar = {"theta": theta + tilt * step, "fi": 60.0 * step, "r": 1.0}
                metadata = {
                    "format": "jpeg",
                    "camera_metadata": {"camera_name": "imx519", "camera_settings": {}, "raw_metadata": {}},
                    "scan_metadata": {"step": step, "polar_coordinates": polar, "project_name": "cup"},
                }
                put(scan / "metadata" / f"{name}.json", json.dumps(metadata).encode())
            names += [f"{name}.jpg" for name in inner]
            if stacked:
                put(scan / "stacked" / f"stacked_{stem}.jpg", picture(step))
                names.append(f"stacked/stacked_{stem}.jpg")
        put(scan / "scan.json", json.dumps({"index": index, "photos": names}).encode())
        scans[f"scan{index:02d}"] = {"index": index, "created": "2026-02-01T10:00:00"}
    put(folder / "openscan_project.json", json.dumps({"name": "cup", "scans": scans}).encode())
    return folder


def test_the_angles_of_the_table_are_those_of_each_photograph(tmp_path, picture, put):
    result = import_photos(project(tmp_path / "cup", picture, put), tmp_path / "s")
    assert (result.layout, result.cameras, result.shots) == ("openscan3", 2, 2 * STOPS)
    session = Session.open(tmp_path / "s")
    table = session.turntable()
    assert table is not None
    for shot in session.shots():
        assert table.degrees[shot.frame] == 60.0 * int(Path(shot.source).stem[-3:])
    frames = {
        camera: {s.frame for s in session.shots() if s.camera == camera} for camera in ("scan01", "scan02")
    }
    assert not frames["scan01"] & frames["scan02"]


def test_a_rotor_that_moves_leaves_no_angles(tmp_path, picture, put):
    result = import_photos(project(tmp_path / "cup", picture, put, tilt=3.0), tmp_path / "s")
    assert Session.open(tmp_path / "s").turntable() is None
    assert any("rotor moves" in guess for guess in result.guesses)


def test_of_a_focus_stack_the_merged_photograph_is_read(tmp_path, picture, put):
    result = import_photos(project(tmp_path / "cup", picture, put, (60.0,), stacked=True), tmp_path / "s")
    session = Session.open(tmp_path / "s")
    assert {Path(shot.source).name for shot in session.shots()} == {
        f"stacked_scan01_{step:03d}.jpg" for step in range(STOPS)
    }
    assert session.turntable().degrees[2] == 120.0
    assert any("12 photos of focus stacks" in guess for guess in result.guesses)


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("openscan_project.json", "{}", "has no scans"),
        ("scan01/scan.json", '{"photos": 3}', "no list of photos"),
        ("scan01/scan.json", '{"photos": ["cup.jpg"]}', "has no number"),
        ("scan01/scan.json", '{"photos": ["../../scan01_001.jpg"]}', "scan01_001.jpg"),
        ("scan01/metadata/scan01_001.json", '{"scan_metadata": {}}', "polar_coordinates"),
    ],
)
def test_damaged_records_are_named(tmp_path, picture, put, file, text, message):
    folder = project(tmp_path / "cup", picture, put)
    (folder / file).write_text(text)
    with pytest.raises(InputError, match=message):
        import_photos(folder, tmp_path / "s")
    assert not (tmp_path / "s").exists()
