"""The folder that a calibration is written into: record, a picture of each view, COLMAP model, exports."""

from collections.abc import Iterable

from calib.exports.formats import write_exports
from calib.exports.training_pictures import PointColours
from calib.poses.sfm import SceneModel
from imaging.arrays import Bytes
from imaging.files import store
from imaging.files.photo import encode_png
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId


def write_calibration(
    session: Session,
    record: CalibrationRecord,
    shown: Iterable[tuple[ViewId, Bytes]],
    model: SceneModel | None,
    progress: Progress,
) -> None:
    """Replace the session's `calibration/` as a whole.

    Args:
        session: Calibrated session.
        record: Calibration to write.
        shown: Picture of each view, sRGB codes, uint8 [H, W, 3]; taken one at a time.
        model: Scene model, written as COLMAP's with the colours of the pictures; None if it has none.
        progress: Callback for the current step, the steps done, and all of them.

    Raises:
        StorageError: The disk refuses; the folder that was there stays.
    """
    with store.replacing(session.folder / "calibration") as part:
        part.mkdir()
        colours = None if model is None else PointColours(model.reconstruction)
        for done, (view, picture) in enumerate(shown):
            progress("writing the pictures", done, len(record.views) + len(record.unregistered))
            file = part / "previews" / view.image_name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(encode_png(picture))
            if colours is not None:
                colours.add(view.image_name, picture)
        progress("writing the calibration", 0, 1)
        if model is not None and colours is not None:
            colours.apply()
            (part / "colmap").mkdir()
            try:
                model.reconstruction.write(str(part / "colmap"))
            except RuntimeError as error:  # which is how pycolmap reports a full disk
                raise OSError(str(error)) from error
        store.write_json(part / "calibration.json", record.model_dump(mode="json"))
        write_exports(
            part,
            record,
            session.record.cameras,
            {} if model is None else model.lenses,
            None if model is None else model.reconstruction,
        )
    progress("writing the calibration", 1, 1)
