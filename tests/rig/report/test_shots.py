"""Statistics of a photograph's file, against its own samples in float64."""

import base64
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from capture.pictures.read import examine
from imaging.arrays import Bytes
from imaging.colour.spaces import srgb_decode
from imaging.files import store
from imaging.files.photo import encode_jpeg, encode_png
from imaging.progress import unreported
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.records import CameraRecord, SessionRecord, ShotRecord
from imaging.session.session import Session
from rig.report.sections.shots import CLIPPED, DARK, read_preview, read_previews


def a_shot(folder: Path, codes: Bytes | npt.NDArray[np.uint16]) -> tuple[Session, ShotRecord]:
    """A session of one photograph."""
    camera = CameraRecord(name="cam", serial="1", kind="ldr")
    session = Session.create(
        folder,
        SessionRecord(
            name="made", created=datetime(2026, 1, 1, tzinfo=UTC), origin="test", cameras=(camera,)
        ),
    )
    file = "raw/0000/cam_0.png"
    store.write_bytes(folder / file, encode_png(codes))
    shot = ShotRecord(
        kind="scene", plan="test", camera="cam", frame=0, step=0, file=file,
        sha256=store.sha256(folder / file), width=codes.shape[1], height=codes.shape[0],
    )  # fmt: skip
    return session, shot


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("size", [(97, 771), (40, 30), (2, 1030), (519, 520)])
def test_a_photograph_is_averaged_in_linear_light(tmp_path: Path, depth: int, size: tuple[int, int]) -> None:
    rng = np.random.default_rng(depth)
    top = 2**depth - 1
    codes = rng.integers(0, top, (*size, 3), np.uint16 if depth == 16 else np.uint8)
    codes[0, 0] = (top, 0, 0)  # one channel clipped spoils its pixel
    preview = read_preview(*a_shot(tmp_path / "S", codes))
    values = codes / top
    assert preview.clipped == pytest.approx(np.mean(values > CLIPPED))
    assert preview.dark == pytest.approx(np.mean(values < DARK))
    factor = max(1, min(size[1] // 256, size[0]))
    height, width = size[0] // factor, size[1] // factor
    assert preview.rgb.shape == (height, width, 3)

    def block(row: int, column: int) -> tuple[slice, slice]:
        return slice(factor * row, factor * (row + 1)), slice(factor * column, factor * (column + 1))

    for row, column in ((0, 0), (height - 1, width - 1), (height // 2, width // 3)):
        codes = values[block(row, column)]
        np.testing.assert_allclose(preview.rgb[row, column], srgb_decode(codes).mean((0, 1)), atol=1e-6)
        assert preview.valid[row, column] == bool((codes <= CLIPPED).all())
    assert not preview.valid[0, 0]


def a_walk(folder: Path, count: int) -> Session:
    """A session of so many photographs, the last of them torn."""
    session, first = a_shot(folder, np.full((24, 32, 3), 100, np.uint8))
    for frame in range(count):
        file = f"raw/{frame:04d}/cam_0.png"
        store.write_bytes(folder / file, encode_png(np.full((24, 32, 3), 10 * frame + 5, np.uint8)))
        session.append_shot(first.model_copy(update={"frame": frame, "file": file}))
    (folder / file).write_bytes(b"torn")
    return session


def test_views_are_shown_in_their_order_and_torn_ones_are_named(tmp_path: Path) -> None:
    previews = read_previews(a_walk(tmp_path / "S", 9), unreported)
    assert (previews.views, previews.of_views) == (9, 9)
    assert [thumbnail.frame for thumbnail in previews.thumbnails] == list(range(8))
    assert previews.unreadable == ("raw/0008/cam_0.png",)
    assert len(previews.shares) == 8


def test_when_time_is_up_the_views_seen_by_then_are_spread_evenly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, looked = a_walk(tmp_path / "S", 20), []

    def look(*given: object) -> object:
        looked.append(given)
        return read_preview(*given)  # type: ignore[arg-type]

    monkeypatch.setattr("rig.report.sections.shots.read_preview", look)
    monkeypatch.setattr("rig.report.sections.shots.thread_count", lambda: 1)
    monkeypatch.setattr("rig.report.sections.shots.time.monotonic", lambda: float(len(looked)))
    previews = read_previews(session, unreported, 4.0)
    frames = [thumbnail.frame for thumbnail in previews.thumbnails]
    assert (previews.views, previews.of_views, len(looked)) == (4, 20, 4)
    assert frames[0] < 5
    assert frames[-1] >= 10
    assert max(np.diff(frames)) <= 8
    assert read_previews(session, unreported, 0.0).views == 1


def test_thumbnails_are_upright(tmp_path: Path) -> None:
    codes = np.zeros((40, 60, 3), np.uint8)
    codes[:10, :10] = 200
    session, shot = a_shot(tmp_path / "s", codes)
    session.append_shot(shot.model_copy(update={"file": "raw/0000/cam_0.jpg"}))
    path = session.folder / "raw/0000/cam_0.jpg"
    store.write_bytes(path, encode_jpeg(codes, metadata=FrameMetadata(orientation=6)))
    (thumbnail,) = read_previews(session, unreported).thumbnails
    for data in (base64.b64decode(thumbnail.uri.partition(",")[2]), examine(path).thumbnail):
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape == (60, 40, 3)
        assert picture[0, -1].min() > 100
        assert picture[-1].max() < 50
