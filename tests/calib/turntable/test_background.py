"""Masks of made photographs: a disc that turns before a still wall, and sessions without anything to mask."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.evidence import gather
from calib.request import CalibrationRequest
from calib.turntable.background import without_background
from imaging.files import store
from imaging.merge.masks import read_mask
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.session.records import Rung
from imaging.session.session import TURNTABLE, Session
from imaging.session.turntable import TurntableRecord

from ..conftest import make_session

HEIGHT, WIDTH, STOPS = 120, 160, 8
Y, X = np.mgrid[:HEIGHT, :WIDTH] + 0.5
DISC = np.hypot(X - 80, Y - 60) < 36


def block(stop: int) -> np.ndarray:
    """True where a block beyond the disc stands at a stop: at each side in turn, in one half of the stops."""
    beside = (X > 120) & (X < 144) & (Y > 44) & (Y < 76)
    return beside if stop % 2 else np.zeros_like(beside)


def texture(seed: int) -> np.ndarray:
    coarse = np.random.default_rng(seed).uniform(40, 200, (HEIGHT // 10, WIDTH // 10, 3)).astype(np.float32)
    return cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)


def session_of(folder: Path, *, stops: int = STOPS, turns: bool = True, still: bool = True) -> Session:
    """Photographs of a wall, a disc and a block, whose light goes up and down by three in a hundred."""
    rng, views = np.random.default_rng(0), []
    for stop in range(stops):
        picture = texture(1 if still else 500 + stop)
        if turns:
            picture = np.where((DISC | block(stop))[..., None], texture(100 + stop), picture)
        picture = picture * (1 + 0.03 * np.sin(stop)) + rng.normal(0, 0.7, picture.shape)
        views.append(
            [(np.rint(picture.clip(0, 255)).astype(np.uint8), Exposure(time=0.01, f_number=8, iso=100))]
        )
    session = Session.open(make_session(folder, views))
    table = TurntableRecord(reason="test", degrees={n: 45.0 * n for n in range(stops)}, spread=0.2)
    store.write_json(session.folder / TURNTABLE, table.model_dump(mode="json"))
    return session


def masked(session: Session) -> Rung:
    _, rungs = without_background(gather(session, CalibrationRequest(), unreported), unreported)
    (rung,) = rungs
    return rung


def test_what_turns_shows_at_its_stop_and_the_wall_behind_it_at_the_others(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s")
    assert masked(session).taken
    for shot in session.shots():
        assert shot.mask is not None
        shown = read_mask(session.folder / shot.mask, HEIGHT, WIDTH)
        true = DISC | block(shot.frame)
        inner, outer = (cv2.dilate(area.astype(np.uint8), np.ones((9, 9))) == 0 for area in (~true, true))
        assert shown[inner].all()
        assert not shown[outer].any()
    assert session.shots()[0].mask_sha256 == store.sha256(session.folder / str(session.shots()[0].mask))
    # The masks of a first run serve the next one.
    lines = (session.folder / "shots.jsonl").read_bytes()
    assert masked(session).taken
    assert (session.folder / "shots.jsonl").read_bytes() == lines


@pytest.mark.parametrize(
    ("made", "why"),
    [
        ({"stops": 3}, "has 3 stops"),
        ({"turns": False}, "nothing in the pictures"),
        ({"still": False}, "everything in the pictures"),
    ],
)
def test_nothing_is_masked_without_evidence(tmp_path: Path, made: dict, why: str) -> None:
    session = session_of(tmp_path / "s", **made)
    rung = masked(session)
    assert not rung.taken
    assert why in rung.reason
    assert {shot.mask for shot in session.shots()} == {None}


def test_photographs_that_came_with_masks_keep_them(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s")
    for shot in session.shots():
        session.append_shot(shot.model_copy(update={"mask": "raw/mask.png"}))
    rung = masked(session)
    assert not rung.taken
    assert "came with masks" in rung.reason
    assert {shot.mask for shot in session.shots()} == {"raw/mask.png"}
