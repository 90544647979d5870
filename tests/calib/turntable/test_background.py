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
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import RawMosaic
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
    exposure = Exposure(time=0.01, f_number=8, iso=100)
    pictures = pictures_of(stops, turns, still)
    views = [[(np.rint(picture.clip(0, 255)).astype(np.uint8), exposure)] for picture in pictures]
    return on_a_turntable(make_session(folder, views), stops)


def pictures_of(stops: int, turns: bool, still: bool) -> list[np.ndarray]:
    rng, pictures = np.random.default_rng(0), []
    for stop in range(stops):
        picture = texture(1 if still else 500 + stop)
        if turns:
            picture = np.where((DISC | block(stop))[..., None], texture(100 + stop), picture)
        pictures.append(picture * (1 + 0.03 * np.sin(stop)) + rng.normal(0, 0.7, picture.shape))
    return pictures


def on_a_turntable(folder: Path, stops: int) -> Session:
    table = TurntableRecord(reason="test", degrees={n: 45.0 * n for n in range(stops)}, spread=0.2)
    store.write_json(folder / TURNTABLE, table.model_dump(mode="json"))
    return Session.open(folder)


def masked(session: Session) -> Rung:
    _, rungs = without_background(gather(session, CalibrationRequest(), unreported), unreported)
    (rung,) = rungs
    return rung


def require_true_masks(session: Session) -> None:
    for shot in session.shots():
        assert shot.mask is not None
        shown = read_mask(session.folder / shot.mask, HEIGHT, WIDTH)
        true = DISC | block(shot.frame)
        inner, outer = (cv2.dilate(area.astype(np.uint8), np.ones((9, 9))) == 0 for area in (~true, true))
        assert shown[inner].all()
        assert not shown[outer].any()


def test_what_turns_shows_at_its_stop_and_the_wall_behind_it_at_the_others(tmp_path: Path) -> None:
    session = session_of(tmp_path / "s")
    assert masked(session).taken
    require_true_masks(session)
    assert session.shots()[0].mask_sha256 == store.sha256(session.folder / str(session.shots()[0].mask))
    # The masks of a first run serve the next one.
    lines = (session.folder / "shots.jsonl").read_bytes()
    assert masked(session).taken
    assert (session.folder / "shots.jsonl").read_bytes() == lines


def test_stops_are_compared_in_the_exposures_that_both_have(tmp_path: Path) -> None:
    """The first stop and the last one have none in common."""
    pictures = [mosaic(picture, Cfa.RGGB) for picture in pictures_of(STOPS, turns=True, still=True)]
    views = [
        [
            (
                RawMosaic(np.rint(64 + 1200 * time * picture).astype(np.uint16), Cfa.RGGB, ((64,),), 4095),
                Exposure(time=time, f_number=8, iso=100),
            )
            for time in (0.005, 0.01)
        ]
        for picture in pictures
    ]
    folder = make_session(tmp_path / "s", views)
    taken = store.read_lines(folder / "shots.jsonl")
    (folder / "shots.jsonl").unlink()
    for shot in taken:
        if (shot["frame"], shot["step"]) not in {(0, 0), (STOPS - 1, 1)}:
            store.append_line(folder / "shots.jsonl", shot)
    session = on_a_turntable(folder, STOPS)
    assert masked(session).taken
    require_true_masks(session)


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
