"""The commands that a report gives to reproduce it, from the records of sessions."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest

from imaging.files.store import write_bytes
from imaging.optics.exposure import Exposure
from imaging.session.calibration import COLOUR, CalibrationRecord
from imaging.session.records import CameraRecord, PlanRecord, Rung, SessionRecord, ShotRecord
from imaging.session.session import Session
from rig.report.sections.provenance import provenance

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def session_of(
    folder: Path, origin: str, sources: Sequence[str] = (), asked: str | None = None, frames: int = 1
) -> Session:
    """A session called S, of photographs from these paths, or of a plan that asked for a bracket."""
    cameras = (CameraRecord(name="cam", serial="1", kind="ldr"),)
    session = Session.create(
        folder / "S", SessionRecord(name="S", created=NOW, origin=origin, cameras=cameras)
    )
    session.append_plan(
        PlanRecord(
            plan="scene", kind="scene", created=NOW, bracket=(Exposure(time=1),),
            frames=tuple(range(frames)), cameras=("cam",), reason="made", asked=asked,
        )
    )  # fmt: skip
    write_bytes(session.folder / "shots.jsonl", b"")
    for frame, source in enumerate(sources):
        session.append_shot(
            ShotRecord(
                kind="scene", plan="scene", camera="cam", frame=frame, step=0, file=f"{frame}.png",
                sha256="0", width=4, height=3, source=source,
            )
        )  # fmt: skip
    return session


def calibrated(*rungs: tuple[str, str]) -> CalibrationRecord:
    return CalibrationRecord(
        created=NOW,
        versions={},
        shots_sha256="0",
        cameras=(),
        views=(),
        exposure_scale={},
        rungs=tuple(Rung(name=name, taken=True, reason=reason) for name, reason in rungs),
    )


def commands(session: Session, calibration: CalibrationRecord | None = None) -> tuple[str, ...]:
    return provenance(session, calibration, None, "1").commands


@pytest.mark.parametrize(
    ("sources", "path"),
    [
        (["a b/camA/0.jpg", "a b/camB/0.jpg"], "'a b'"),
        (["photos/0.jpg", "photos/1.jpg"], "photos"),
        (["/films/walk.MOV: 0001.png", "/films/walk.MOV: 0002.png"], "/films/walk.MOV"),
        ([], "PHOTOS"),
    ],
)
def test_an_import_is_of_all_its_photographs_or_the_video(tmp_path: Path, sources, path: str) -> None:
    assert commands(session_of(tmp_path, "import", sources)) == (f"rig import {path} S",)


@pytest.mark.parametrize(
    ("there", "photo", "reason"),
    [
        ("data/transforms.json", "data/images/0.jpg", "transforms.json"),
        ("data/sparse/0/images.txt", "data/photos/0.jpg", "sparse/0"),
        ("data/sparse/images.txt", "data/photos/0.jpg", "data/sparse"),
        ("data/images.txt", "data/photos/0.jpg", "{parent}/data"),
        (None, "data/images/0.jpg", "transforms.json"),
    ],
)
def test_poses_that_were_given_are_of_the_folder_that_holds_them(
    tmp_path: Path, there: str | None, photo: str, reason: str
) -> None:
    if there is not None:
        write_bytes(tmp_path / there, b"")
    session = session_of(tmp_path, "import", [str(tmp_path / photo)])
    poses = ("poses", f"given by {reason.format(parent=tmp_path.name)}, not measured")
    command = f"rig import {tmp_path / 'data'} S"
    assert commands(session, calibrated(poses, (COLOUR, "of the files"))) == (command,)
    measured = calibrated(("response_curve", "measured"), poses)
    assert commands(session, measured) == (command, "rig calibrate S --only response")
    assert commands(session, calibrated(("response_curve", "measured")))[1] == "rig calibrate S"


@pytest.mark.parametrize(
    ("asked", "options"),
    [
        (None, "--frames 2"),
        ("stops -2, 0, 2", "--frames 2 --bracket -2,0,2"),
        ("auto, snr 20, highest iso 800", "--frames 2 --bracket auto --snr 20 --highest-iso 800"),
    ],
)
def test_a_simulated_capture_has_the_frames_and_the_bracket_of_its_plan(
    tmp_path: Path, asked: str | None, options: str
) -> None:
    session = session_of(tmp_path, "sim:toy", asked=asked, frames=2)
    assert commands(session) == (f"rig capture --sim toy --seed 0 {options} S",)
