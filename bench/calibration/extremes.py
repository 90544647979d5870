"""Calibration of sessions at the extremes, for bench/calibration/poses.py: figures, or a refusal."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np

from bench.calibration import board as boards
from bench.calibration.pose_error import auc, found_poses, pairs
from calib.boards.corners import PRINTS, Print, find_all
from calib.calibrate import calibrate
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.arrays import Array, Mask
from imaging.errors import CalibrationError, PartialError
from imaging.files import store
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.progress import unreported
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.session.calibration import read_calibration
from imaging.session.records import CameraRecord, SessionRecord, ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId

CAMERAS, FRAMES = 2, 4
GAIN, READ, WELL, BLACK = 0.4, 3.0, 9500.0, 256
WHITE = BLACK + int(GAIN * WELL)
USUAL = (1 / 1024, 1 / 64, 1 / 4)
BOARD_FRAMES = 20


@cache
def studio() -> tuple[SimulatedRig, dict[ViewId, Array], dict[ViewId, Array]]:
    """A rig, and by view the light [H, W, 3] and the true pose; rendered once."""
    rig = simulate("demo", 3, cameras=CAMERAS, positions=FRAMES, samples=2)
    views = [ViewId(frame, f"cam{camera}") for camera in range(CAMERAS) for frame in range(FRAMES)]
    light = {view: rig.radiance(int(view.camera[3:]), view.frame).astype(np.float64) for view in views}
    return rig, light, {view: rig.cam_from_world(int(view.camera[3:]), view.frame) for view in views}


def exposed(light: Array, time: float, rng: np.random.Generator, hot: Mask | None) -> RawMosaic:
    """A RAW frame of a sensor of WELL electrons; hot: which sites are always white, [H, W]."""
    sites = np.empty(light.shape[:2])
    for (row, column), channel in zip(((0, 0), (0, 1), (1, 0), (1, 1)), (0, 1, 1, 2), strict=True):
        sites[row::2, column::2] = light[row::2, column::2, channel]
    electrons = rng.poisson(np.minimum(WELL * sites * time, 2 * WELL)) + rng.normal(0, READ, sites.shape)
    codes = np.clip(np.rint(BLACK + GAIN * np.minimum(electrons, WELL)), 0, WHITE)
    if hot is not None:
        codes[hot] = WHITE
    span = WHITE - BLACK
    profile = (GAIN / span, (GAIN * READ / span) ** 2)
    return RawMosaic(codes.astype(np.uint16), Cfa.RGGB, ((BLACK,),), WHITE, noise_profile=profile)


def session(
    folder: Path,
    views: dict[ViewId, Array],
    times: Sequence[float],
    labels: Sequence[float] | None = None,
    hot: float = 0.0,
) -> Path:
    """A session of views; labels: the times that it states; hot: share of photosites."""
    rng = np.random.default_rng(0)
    names = sorted({view.camera for view in views})
    records = tuple(
        CameraRecord(name=name, serial=name, make="Bench", model="One", kind="raw", rig="arm")
        for name in names
    )
    made = Session.create(
        folder, SessionRecord(name="extreme", created=datetime.now(UTC), origin="bench", cameras=records)
    )
    shape = next(iter(views.values())).shape[:2]
    spots = {name: rng.random(shape) < hot for name in names}
    for view, light in views.items():
        for step, time in enumerate(times):
            file = f"raw/{view}_{step}.dng"
            store.make_folder((folder / file).parent)
            write_dng(folder / file, exposed(light, time, rng, spots[view.camera] if hot else None))
            made.append_shot(
                ShotRecord(
                    kind="scene", plan="bench", camera=view.camera, frame=view.frame, step=step, file=file,
                    sha256=store.sha256(folder / file), width=shape[1], height=shape[0],
                    reported=Exposure(time=(labels or times)[step]),
                )
            )  # fmt: skip
    return folder


def posed(
    times: Sequence[float] = USUAL,
    *,
    views: dict[ViewId, Array] | None = None,
    true: dict[ViewId, Array] | None = None,
    labels: Sequence[float] | None = None,
    hot: float = 0.0,
) -> str:
    """Return what becomes of a session, in half a sentence."""
    _, light, poses = studio()
    views, true = views or light, true or poses
    with TemporaryDirectory() as work:
        folder = session(Path(work) / "session", views, times, labels, hot)
        try:
            record = calibrate(folder)
        except PartialError as error:
            return f"partly: {error}".replace(f"{folder}: ", "")
        except CalibrationError as error:
            return f"refused: {error}".replace(f"{folder}: ", "")
        record = read_calibration(folder)
    placed_views = found_poses(record)
    errors = pairs(placed_views, true)
    placed = errors[np.isfinite(errors[:, 0])]
    words = (
        f"{len(placed_views)} of {len(true)} placed, AUC@1 {auc(errors, 1.0):.3f}, "
        f"rotation {np.median(placed[:, 0]):.3f}°, "
    )
    words += "named as taken from one place" if record.turned else f"direction {np.median(placed[:, 1]):.3f}°"
    if labels is not None:
        scale = [record.exposure_scale[f"raw/0000/cam0_{step}.dng"] for step in range(len(times))]
        off = np.array(scale) / scale[-1] / (np.array(times) / times[-1]) - 1
        words += f", exposure ratios within {100 * np.abs(off).max():.2g} %"
    return words


def turning() -> str:
    rig, _, _ = studio()
    views, true = {}, {}
    for frame in range(FRAMES):
        turn = np.eye(4)
        turn[:3, :3] = cv2.Rodrigues(np.array([0.02 * frame, 0.1 * frame - 0.15, 0.0]))[0]
        view = ViewId(frame, "cam0")
        pose = true[view] = turn @ rig.cam_from_world(0, 0)
        views[view] = rig.scene.render(rig.mounts[0].optics.lens, pose, 2).astype(np.float64)
    return posed(views=views, true=true)


def wide() -> str:
    """A filter that dims from right to left by 14 stops before the scene, which has 14 of its own."""
    _, light, _ = studio()
    views = {
        key: picture * 2.0 ** np.linspace(-10, 4, picture.shape[1])[:, None] for key, picture in light.items()
    }
    return posed(tuple(4.0**power for power in range(-8, 4)), views=views)


def one_camera() -> str:
    _, light, true = studio()
    views, true_poses = ({key: part[key] for key in light if key.camera == "cam0"} for part in (light, true))
    return posed(views=views, true=true_poses)


def twice() -> str:
    _, light, true = studio()
    both = [
        {**part, **{ViewId(FRAMES, name): part[ViewId(1, name)] for name in ("cam0", "cam1")}}
        for part in (light, true)
    ]
    return posed(views=both[0], true=both[1])


def apart() -> str:
    """A board that no frame shows to both halves of the rig."""
    rig = boards.rig_of(3)
    corners = {
        key: points
        for key, points in boards.corners(rig, BOARD_FRAMES).items()
        if (key.camera in ("cam0", "cam1")) == (key.frame % 2 == 0)
    }
    group = boards.solved(rig, corners)
    assert group.solved is not None
    errors = boards.relative(rig, group.solved.cam_from_rig)
    return (
        f"named as never seen together with the others: {', '.join(group.isolated)}; the others: "
        f"rotation {max(turn for _, turn, _ in errors):.3f}°, {max(shift for *_, shift in errors):.2f} mm"
    )


def printed(as_printed: Print) -> str:
    """A board as printed before OpenCV 4.6, or with black for white; 6 rows, where the patterns differ."""
    board = boards.BOARD.model_copy(update={"rows": 6})
    view = ViewId(0, "a")
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    layout = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, dictionary)
    layout.setLegacyPattern(as_printed.legacy)
    flat = np.pad(np.asarray(layout.generateImage((700, 600))), 40, constant_values=255)
    image = np.asarray(255 - flat if as_printed.inverted else flat, np.uint8)
    try:
        by_view, recognised = find_all(board, [view], lambda key: image, unreported)
    except CalibrationError as error:
        return f"refused: {error}"
    corners = by_view[view]
    off = np.abs(corners.points - (board.corners()[corners.ids, :2] / board.square * 100 + 40)).max()
    return f"recognised as {recognised}, {len(corners.ids)} of 30 corners, within {off:.2f} px"


def cases() -> dict[str, Callable[[], str]]:
    """All of them, by name."""
    by_name: dict[str, Callable[[], str]] = {
        "as usual: three exposures, 16 times apart": posed,
        "exposures 2^20 apart, one all white": lambda: posed((1 / 64, 2.0**14)),
        "exposures 2^20 apart, one all black": lambda: posed((2.0**-26, 1 / 64)),
        "two exposures": lambda: posed(USUAL[1:]),
        "one exposure": lambda: posed(USUAL[1:2]),
        "a frame twice": twice,
        "labels wrong by 2x": lambda: posed(labels=(USUAL[0], 2 * USUAL[1], USUAL[2])),
        "all saturated": lambda: posed((2.0**10, 2.0**12)),
        "all dark": lambda: posed((2.0**-26, 2.0**-24)),
        "one camera": one_camera,
        "pure rotation": turning,
        "28 stops": wide,
        "hot sensor: one photosite in 200 white": lambda: posed(hot=0.005),
        "board that two pairs of cameras never share": apart,
    }
    for as_printed in PRINTS[1:]:
        by_name[f"ChArUco board, {as_printed}"] = partial(printed, as_printed)
    return by_name


def outcome(name: str) -> dict[str, Any]:
    """A row."""
    return {"case": name, "outcome": cases()[name]()}
