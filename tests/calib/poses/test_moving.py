"""Frames that follow each other as those of a video are doubted, and no others."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from calib.poses.moving import rungs
from imaging.session.records import ShotRecord

BEGIN = datetime(2026, 5, 1, tzinfo=UTC)


def shots(moments: Sequence[float | None], camera: str = "cam", steps: int = 1) -> list[ShotRecord]:
    return [
        ShotRecord(
            kind="scene", plan="p", camera=camera, frame=frame, step=step, file=f"{frame}_{step}", sha256="",
            width=4, height=3,
            captured_at=None if moment is None else BEGIN + timedelta(seconds=moment + 0.05 * step),
        )
        for frame, moment in enumerate(moments)
        for step in range(steps)
    ]  # fmt: skip


def doubts(taken: list[ShotRecord]) -> list[str]:
    granted, *others = rungs(taken)
    assert not granted.taken
    assert all(rung.taken for rung in others)
    return [rung.reason for rung in others]


def test_a_video_is_doubted() -> None:
    still, video = shots([10.0 * frame for frame in range(8)], "still"), shots([0.1 * i for i in range(8)])
    (reason,) = doubts([*still, *video])
    assert reason.startswith("cam took a frame every 0.1 s")


def test_what_stands_between_frames_is_not() -> None:
    assert not doubts(shots([2.0 * frame for frame in range(8)], steps=4))  # a bracket is one frame
    assert not doubts(shots([0.1, 0.2, 0.3]))  # too few
    assert not doubts(shots([None] * 8))
    assert not doubts(shots([0.0] * 8))  # a clock that was never set
    assert not doubts([])
