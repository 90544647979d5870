"""Sessions that the tests of calibration share: one simulated and calibrated, others made to measure."""

import os
import pickle
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from calib.data.unfinished import FOLDER
from imaging.files import store
from imaging.files.photo import encode_jpeg
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from imaging.session.records import CameraRecord, SessionRecord, ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from tests.conftest import MadeOnce, fewer_features

if TYPE_CHECKING:
    from calib.view_images import ViewSummary

STEPS, LOOKS = "arm-steps", "arm-looks"
"""What stands beside the arm: the folder of its unfinished calibration, and the summaries of its views."""


@pytest.fixture(scope="module", autouse=True)
def _fewer_features() -> Iterator[None]:
    with fewer_features():  # a module at a time: tests of other folders in the same process want them all
        yield


@pytest.fixture(scope="session")
def arm(demo_capture: Path, made_once: MadeOnce) -> Path:
    """The demo's rig at three of its six positions, captured and calibrated; copy it before changing it.

    Beside it is what the calibration had done when all views were placed, for `arm_looks` and `unsurveyed`.
    """
    from calib import view_images
    from calib.calibrate import calibrate

    def make(folder: Path) -> None:
        shutil.copytree(demo_capture, folder, dirs_exist_ok=True)
        looks: dict[ViewId, view_images.ViewSummary] = {}
        summaries = view_images.summaries

        def remembered(*rest: Any) -> dict[ViewId, view_images.ViewSummary]:
            looks.update(summaries(*rest))
            return dict(looks)

        def copied(message: str, done: int, total: int) -> None:
            if (message, done) == ("measuring how sure it is", 0):
                shutil.copytree(folder / FOLDER, folder.with_name(STEPS))

        with fewer_features(), pytest.MonkeyPatch.context() as patch:
            patch.setattr(view_images, "summaries", remembered)
            calibrate(folder, on_progress=copied)
        folder.with_name(LOOKS).write_bytes(pickle.dumps(looks))

    return made_once("arm", make)


@pytest.fixture(scope="session")
def arm_looks(arm: Path) -> dict[ViewId, "ViewSummary"]:
    """Summaries of the arm's views; to make them again takes a third of a calibration."""
    looks: dict[ViewId, ViewSummary] = pickle.loads(arm.with_name(LOOKS).read_bytes())
    return looks


@pytest.fixture
def own_arm(arm: Path, tmp_path: Path) -> Path:
    """The same, of one's own."""
    return Path(shutil.copytree(arm, tmp_path / "session"))


@pytest.fixture(scope="session")
def real() -> Path:
    """The folder of real data; skips without it."""
    folder = os.environ.get("RIG_DATA")
    if not folder:
        pytest.skip("RIG_DATA names no folder of real data")
    return Path(folder)


@contextmanager
def even_light() -> Iterator[None]:
    """No falloff of lenses is measured, nor sensitivities: for tests of poses alone, since both take long."""
    from calib.light import vignetting

    def even(tracks: object, cameras: Sequence[str], *rest: object, **more: object) -> vignetting.Falloff:
        return vignetting.Falloff(dict.fromkeys(cameras, (0.0, 0.0, 0.0)), dict.fromkeys(cameras, 1.0), ())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vignetting, "estimate", even)
        yield


def make_session(
    folder: Path,
    views: Sequence[Sequence[tuple[np.ndarray | RawMosaic, Exposure | None]]],
    *,
    cameras: Sequence[str] | None = None,
) -> Path:
    """A session whose view i holds the given exposures: uint8 [H, W, 3] as JPEG, or mosaics as DNG.

    cameras: of each view, frames being counted for each; one camera when None.
    """
    from imaging.files.tiff.dng import write_dng

    names = list(cameras or ["cam"] * len(views))
    kind = "raw" if isinstance(views[0][0][0], RawMosaic) else "ldr"
    records = tuple(
        CameraRecord(name=name, serial=name, make="Maker", model="One", kind=kind)
        for name in sorted(set(names))
    )
    session = Session.create(
        folder, SessionRecord(name="made", created=datetime.now(UTC), origin="test", cameras=records)
    )
    counts = dict.fromkeys(names, 0)
    for name, exposures in zip(names, views, strict=True):
        frame = counts[name]
        counts[name] += 1
        for step, (image, exposure) in enumerate(exposures):
            suffix = "dng" if isinstance(image, RawMosaic) else "jpg"
            file = f"raw/{frame:04d}/{name}_{step}.{suffix}"
            if isinstance(image, RawMosaic):
                store.make_folder((folder / file).parent)
                write_dng(folder / file, image)
                height, width = image.pixels.shape
            else:
                store.write_bytes(folder / file, encode_jpeg(image, 98))
                height, width = image.shape[:2]
            session.append_shot(
                ShotRecord(
                    kind="scene", plan="test", camera=name, frame=frame, step=step, file=file,
                    sha256=store.sha256(folder / file), reported=exposure, width=width, height=height,
                )
            )  # fmt: skip
    return folder
