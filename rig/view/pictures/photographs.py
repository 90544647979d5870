"""The photographs of a session as small pictures of light, before anything is reconstructed from them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from imaging.and_list import and_more
from imaging.arrays import Array32, Bytes
from imaging.colour.spaces import balanced, of_channels, rec709_from_camera
from imaging.errors import InputError
from imaging.files.photo import read_metadata
from imaging.files.raw import read_raw
from imaging.merge.linear_frame import LinearFrame, from_raw, read_linear
from imaging.optics.pose import picture_as_held
from imaging.sensor.cfa import cell_means
from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response, read_calibration
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId

WIDTH = 320
"""px of each."""
_ASSUMED = Response(kind="srgb", evidence="assumed until it is calibrated")
_LEAST = 1e-12


@dataclass(frozen=True, eq=False)
class Photograph:
    """Photographs of a view: its light [h, w, 3], upright, linear Rec.709 as far as colours are known, and
    its shots, in words.

    light is None if no file of it can be read; caption then gives the reason, and begins with the view.
    """

    view: ViewId
    light: Array32 | None
    caption: str


class Photographs:
    """The views of a session, read one at a time."""

    def __init__(self, folder: Path) -> None:
        self.session = Session.open(folder)
        self.calibration: CalibrationRecord | None = None
        if (folder / "calibration" / "calibration.json").is_file():
            self.calibration = read_calibration(folder)
        self.groups = brackets(self.session.shots("scene"))

    def __len__(self) -> int:
        return len(self.groups)

    def orientation(self, view: ViewId) -> int:
        """Orientation that EXIF states of the first photograph of a view; 1 where no header can be read."""
        try:
            return read_metadata(self.session.file(self.groups[view][0])).orientation
        except (KeyError, InputError, OSError):
            return 1

    def read(self, view: ViewId, orientation: int | None = None) -> Photograph:
        """Each pixel is the mean of the exposures that hold a number for it, weighted by their length.

        orientation: as of EXIF, by which the picture is turned upright; None: as its file states it.
        """
        shots = self.groups[view]
        ends = [str(shot.exposure) for shot in shots[:: max(1, len(shots) - 1)] if shot.exposure]
        caption = ": ".join([str(view), " to ".join(ends)]) if ends else str(view)
        try:
            parts = [self._small(view, shot) for shot in shots]
        except (InputError, OSError) as error:
            return Photograph(view, None, f"{view}: {error}")
        stated = self.orientation(view) if orientation is None else orientation
        return Photograph(view, picture_as_held(_merged(parts), stated), caption)

    def _small(self, view: ViewId, shot: ShotRecord) -> tuple[Array32, Array32, float]:
        """Signal [h, w, 3] in Rec.709, share of it that is light and no limit [h, w, 1], and its scale."""
        camera = self._camera(view.camera)
        k = self._scale(shot)
        kind = self.session.camera(view.camera).kind
        path, neutral = self.session.file(shot), None
        if kind == "raw":
            raw = read_raw(path)
            frame, neutral = from_raw(raw, k, () if camera is None else camera.sensors), raw.neutral
        else:
            frame = read_linear(path, kind, k, _ASSUMED if camera is None else camera.response)
        return (*_reduced(frame, camera, neutral), k)

    def _camera(self, name: str) -> CameraCalibration | None:
        known = () if self.calibration is None else self.calibration.cameras
        return next((camera for camera in known if camera.name == name), None)

    def _scale(self, shot: ShotRecord) -> float:
        scales = {} if self.calibration is None else self.calibration.exposure_scale
        labelled = 1.0 if shot.exposure is None else shot.exposure.scale
        return scales.get(shot.file, labelled)


def _reduced(
    frame: LinearFrame, camera: CameraCalibration | None, neutral: Sequence[float] | None
) -> tuple[Array32, Array32]:
    useless = frame.saturated | ~frame.valid
    signal, limits = cell_means(frame.signal, frame.cfa), cell_means(useless, frame.cfa)
    if signal.ndim == 2:
        signal, limits = signal[..., None], limits[..., None]
    width = min(WIDTH, signal.shape[1])
    size = (width, max(1, round(width * signal.shape[0] / signal.shape[1])))
    counts = (limits.max(axis=2) == 0).astype(np.float32)
    signal = np.nan_to_num(signal, posinf=0.0, neginf=0.0) * counts[..., None]
    signal = _resized(signal, size)
    share = _resized(counts, size).reshape(size[1], size[0], 1)
    matrix = None if camera is None else camera.camera_from_rec709
    if frame.cfa is None and signal.shape[2] == 3:
        return signal, share
    if matrix is None or signal.shape[2] == 1:
        return balanced(signal, neutral), share
    turn = rec709_from_camera(of_channels(matrix, signal.shape[2]))
    return (signal @ turn.T).astype(np.float32), share


def _resized(image: Array32, size: tuple[int, int]) -> Array32:
    small = cv2.resize(np.asarray(image, np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small.reshape(size[1], size[0], -1), np.float32)


def _merged(parts: Sequence[tuple[Array32, Array32, float]]) -> Array32:
    """Signals over the scales of where they are light; where all are clipped the white of the shortest."""
    total = sum(signal.astype(np.float64) for signal, _, _ in parts)
    weight = sum(share.astype(np.float64) * k for _, share, k in parts)
    white = 1.0 / min(k for _, _, k in parts)
    return np.where(weight > _LEAST, total / np.maximum(weight, _LEAST), white).astype(np.float32)


def sheet(pictures: Sequence[Array32], columns: int) -> Array32:
    """Pictures side by side in rows, each in a cell as large as the largest, black beside them."""
    high, wide = max(one.shape[0] for one in pictures), max(one.shape[1] for one in pictures)
    rows = -(-len(pictures) // columns)
    canvas = np.zeros((rows * high, columns * wide, 3), np.float32)
    for place, one in enumerate(pictures):
        top, left = place // columns * high, place % columns * wide
        canvas[top : top + one.shape[0], left : left + one.shape[1]] = one
    return canvas


def labelled(picture: Bytes, names: Sequence[str], columns: int) -> Bytes:
    """A sheet of that many columns with a name in the upper left of each picture, white on black."""
    shown = picture.copy()
    rows = -(-len(names) // columns)
    high, wide = shown.shape[0] // rows, shown.shape[1] // columns
    for place, name in enumerate(names):
        top, left = place // columns * high, place % columns * wide
        size = 0.4
        (across, up), below = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
        if across + 4 > wide or up + below + 4 > high:
            continue
        shown[top : top + up + below + 2, left : left + across + 4] = 0
        spot = (left + 2, top + up + 1)
        cv2.putText(shown, name, spot, cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 1, cv2.LINE_AA)
    return shown


def in_words(photographs: Iterable[Photograph]) -> list[str]:
    """A line for each kind of shot, with the views that have it; one for all of them where all are alike."""
    views: dict[str, list[str]] = {}
    count = 0
    for one in photographs:
        count += 1
        views.setdefault(one.caption.removeprefix(str(one.view)).removeprefix(": "), []).append(str(one.view))
    if len(views) == 1 and count > 1:
        said = next(iter(views))
        return [f"all: {said}"] if said else []
    return [": ".join(filter(None, (and_more(names, 3), said))) for said, names in views.items()]
