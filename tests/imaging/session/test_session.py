"""Sessions on disk: what is whole is kept, whatever was torn."""

import json
from datetime import datetime
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.session.records import CameraRecord, PlanRecord, SessionRecord, ShotRecord
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId

RECORD = SessionRecord(
    name="demo",
    created=datetime(2024, 5, 6, 7, 8, 9),
    origin="sim:demo",
    seed=3,
    cameras=(
        CameraRecord(name="a", serial="A", kind="raw", rig="r"),
        CameraRecord(name="b", serial="B", kind="raw", rig="r"),
    ),
)


def shot(frame: int = 0, camera: str = "a", step: int = 0, **fields: object) -> ShotRecord:
    values: dict[str, object] = {
        "kind": "scene",
        "plan": "p1",
        "camera": camera,
        "frame": frame,
        "step": step,
        "file": f"raw/{frame:04d}/{camera}_{step}.dng",
        "sha256": "00",
        "width": 64,
        "height": 48,
        "requested": Exposure(time=0.5),
    }
    return ShotRecord.model_validate({**values, **fields})


def plan(name: str = "p1", reason: str = "first") -> PlanRecord:
    return PlanRecord(
        plan=name,
        kind="scene",
        created=datetime(2024, 5, 6),
        bracket=(Exposure(time=0.5), None),
        frames=(0, 1),
        cameras=("a", "b"),
        reason=reason,
    )


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return Session.create(tmp_path / "session", RECORD)


def test_what_was_written_is_read(session: Session) -> None:
    session.append_plan(plan())
    session.append_shot(shot())
    opened = Session.open(session.folder)
    assert opened.record == RECORD
    assert opened.plans() == [plan()]
    assert opened.shots() == [shot()]
    assert opened.camera("b").serial == "B"


def test_a_new_session_has_nothing(session: Session) -> None:
    assert session.plans() == []
    assert session.shots() == []


def test_the_later_of_two_records_counts(session: Session) -> None:
    session.append_shot(shot(0, sha256="old"))
    session.append_shot(shot(1))
    session.append_shot(shot(0, sha256="new"))
    session.append_shot(shot(0, plan="p2"))
    assert [(s.frame, s.plan, s.sha256) for s in session.shots()] == [
        (0, "p1", "new"),
        (1, "p1", "00"),
        (0, "p2", "00"),
    ]
    session.append_plan(plan(reason="first"))
    session.append_plan(plan("p2"))
    session.append_plan(plan(reason="again"))
    assert [(p.plan, p.reason) for p in session.plans()] == [("p1", "again"), ("p2", "first")]


def test_shots_by_kind(session: Session) -> None:
    session.append_shot(shot(0))
    session.append_shot(shot(0, plan="darks", kind="dark"))
    assert [s.plan for s in session.shots("dark")] == ["darks"]
    assert len(session.shots()) == 2


SHOTS = [shot(frame, camera, step) for frame in range(2) for camera in "ab" for step in range(2)]
LINES = [json.dumps(s.model_dump(mode="json", exclude_none=True)) + "\n" for s in SHOTS]
WHOLE = "".join(LINES).encode()


@settings(max_examples=120)
@given(st.integers(0, len(WHOLE)), st.sampled_from([b"", b"\0" * 7, b'{"kind": "sc']))
def test_every_whole_line_survives_a_torn_tail(
    tmp_path_factory: pytest.TempPathFactory, cut: int, tail: bytes
) -> None:
    folder = tmp_path_factory.mktemp("torn")
    session = Session(folder, RECORD)
    (folder / "shots.jsonl").write_bytes(WHOLE[:cut] + tail)
    whole_lines = WHOLE[:cut].count(b"\n")
    assert session.shots() == SHOTS[:whole_lines]


def test_a_torn_session_goes_on(session: Session) -> None:
    for record in SHOTS[:3]:
        session.append_shot(record)
    path = session.folder / "shots.jsonl"
    path.write_bytes(path.read_bytes()[:-5])
    session.append_shot(SHOTS[3])
    assert session.shots() == [*SHOTS[:2], SHOTS[3]]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b"not json\n", "line 1 is not JSON"),
        (b"[]\n", "shots.jsonl"),
        (b'{"kind": "scene"}\n', "field required"),
        (LINES[0].replace("}", ', "x": 1}').encode(), "extra inputs|invalid|not JSON|x"),
    ],
)
def test_a_damaged_line_is_named(session: Session, line: bytes, says: str) -> None:
    (session.folder / "shots.jsonl").write_bytes(line + LINES[1].encode())
    with pytest.raises(InputError, match=says):
        session.shots()


def test_a_folder_that_is_no_session(tmp_path: Path) -> None:
    for folder in (tmp_path / "none", tmp_path):
        with pytest.raises(InputError, match="name a session made by"):
            Session.open(folder)
    (tmp_path / "session.json").write_text("{}")
    with pytest.raises(InputError, match=r"session\.json: name: field required"):
        Session.open(tmp_path)
    (tmp_path / "session.json").write_text('{"schema_version": 99}')
    with pytest.raises(InputError, match="schema version 99"):
        Session.open(tmp_path)
    (tmp_path / "session.json").write_text("torn")
    with pytest.raises(InputError, match="cannot be read as JSON"):
        Session.open(tmp_path)


def test_a_session_is_begun_only_where_nothing_is(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    Session.create(tmp_path / "empty", RECORD)
    with pytest.raises(InputError, match="is not empty"):
        Session.create(tmp_path / "empty", RECORD)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is not empty"):
        Session.create(tmp_path / "file", RECORD)


def test_files_stay_in_the_session(session: Session) -> None:
    assert session.file(shot()) == session.folder / "raw" / "0000" / "a_0.dng"
    with pytest.raises(InputError, match="leads out of"):
        session.file(shot(file="../other/a.dng"))


def test_an_unknown_camera_is_named(session: Session) -> None:
    with pytest.raises(InputError, match="no camera 'c'"):
        session.camera("c")


def test_brackets_are_in_order() -> None:
    groups = brackets(reversed(SHOTS))
    assert list(groups) == [ViewId(0, "a"), ViewId(0, "b"), ViewId(1, "a"), ViewId(1, "b")]
    assert [s.step for s in groups[ViewId(1, "a")]] == [0, 1]
