"""`truth/` of a simulated session, which only an evaluation may read: images, poses, exposures, gains."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imaging.arrays import Array, Array32
from imaging.files import store
from imaging.files.exr.reading import read_exr
from imaging.optics.pose import Pose
from imaging.session.bands import channels
from imaging.session.calibration import CalibrationRecord
from imaging.session.records import Band
from imaging.session.view_id import ViewId
from recon.data.dataset import View
from recon.data.pixels import area_mean


def has_truth(session: Path) -> bool:
    """Return whether the session is a simulated one, with its truth beside it."""
    return (session / "truth" / "truth.json").is_file()


def true_radiance(session: Path, view: View, bands: Sequence[Band] = ()) -> Array32:
    """Return what a view should show, linear Rec.709 [H, W, 3], or [H, W, bands]; averaged over areas to the
    view's size.

    As `recon.data.pixels` makes the view of its files: of RAW the last rows and columns that complete no
    tile, or no pair, are left out first. Of a mono camera it is the grey that it sees, three times.
    """
    image = read_exr(session / "truth" / f"{view.id}.exr")
    light = (
        image.rgb() if not bands else np.stack([image.channels[name] for name in channels(bands)], axis=-1)
    )
    size = view.lens.width, view.lens.height
    if view.sensor.kind == "raw":
        tile = (2, 2) if view.sensor.cfa is None else view.sensor.cfa.period
        height, width = (side - side % length for side, length in zip(light.shape, tile, strict=False))
        light = light[:height, :width]
    if (light.shape[1], light.shape[0]) != size:
        light = area_mean(light, size)
    if not bands and view.sensor.cfa is not None and view.sensor.cfa.mono:
        camera = store.read_json(session / "truth" / "truth.json")["cameras"][view.camera]
        light = np.repeat(light @ np.array(camera["camera_from_rec709"]).T, 3, axis=2)
    return np.ascontiguousarray(light, np.float32)


def calibration_errors(session: Path, calibration: CalibrationRecord) -> dict[str, float]:
    """Return how far a calibration is from the truth; only what can be said is in the result.

    pose_rotation_deg and pose_translation_relative (median over views, and `_max`), exposure_ratio_error
    (median over shots, relative, and `_max`), gain_error and read_noise_error (largest, relative).
    """
    truth = store.read_json(session / "truth" / "truth.json")
    return {
        **_pose_errors(truth, calibration),
        **_exposure_errors(truth, calibration),
        **_camera_errors(truth, calibration),
    }


def _pose_errors(truth: dict[str, Any], calibration: CalibrationRecord) -> dict[str, float]:
    """Pose errors after the best similarity: rotation by the mean of the orientations, scale and shift by
    centres.

    The rotation between the two worlds is taken from the orientations, not from the centres: a rig
    that stands in a line says nothing about the turn around that line. Distances are relative to the
    largest distance between two true centres.
    """
    poses = {
        ViewId(entry["frame"], camera): Pose.model_validate(pose).matrix()
        for entry in truth["frames"]
        for camera, pose in entry["cam_from_world"].items()
    }
    pairs = [(view.cam_from_world.matrix(), poses[view.id]) for view in calibration.views if view.id in poses]
    if len(pairs) < 2:
        return {}
    estimated, true = (np.stack(side) for side in zip(*pairs, strict=True))
    turn = _nearest_rotation(np.einsum("nji,njk->ik", true[:, :3, :3], estimated[:, :3, :3]))
    error = estimated[:, :3, :3] @ turn.T @ true[:, :3, :3].transpose(0, 2, 1)
    sines = np.linalg.norm(error - error.transpose(0, 2, 1), axis=(1, 2)) / (2 * np.sqrt(2))
    cosines = (np.trace(error, axis1=1, axis2=2) - 1) / 2
    degrees = np.degrees(np.arctan2(sines, cosines))

    moved, goal = _centres(estimated) @ turn.T, _centres(true)
    size = float(np.linalg.norm(goal[:, None] - goal[None], axis=-1).max())
    source, target = moved - moved.mean(0), goal - goal.mean(0)
    spread = float((source**2).sum())
    scale = float((source * target).sum()) / spread if spread > 0 else 1.0
    distance = np.linalg.norm(scale * source - target, axis=1) / max(size, 1e-12)
    return {
        "pose_rotation_deg": float(np.median(degrees)),
        "pose_rotation_deg_max": float(degrees.max()),
        "pose_translation_relative": float(np.median(distance)),
        "pose_translation_relative_max": float(distance.max()),
    }


def _nearest_rotation(matrix: Array) -> Array:
    left, _, right = np.linalg.svd(matrix)
    left[:, -1] *= np.sign(np.linalg.det(left @ right))
    return np.asarray(left @ right)


def _centres(cam_from_world: Array) -> Array:
    return np.asarray(-np.einsum("nji,nj->ni", cam_from_world[:, :3, :3], cam_from_world[:, :3, 3]))


def _exposure_errors(truth: dict[str, Any], calibration: CalibrationRecord) -> dict[str, float]:
    """Errors of the ratio of every shot to the longest of its bracket."""
    brackets: dict[ViewId, list[tuple[float, float]]] = {}
    for entry in truth["exposures"]:
        scale = calibration.exposure_scale.get(entry.get("file", ""))
        if scale is not None:
            group = brackets.setdefault(ViewId(entry["frame"], entry["camera"]), [])
            group.append((_true_scale(entry), scale))
    errors = []
    for group in brackets.values():
        longest = max(group)
        errors += [
            abs(scale / longest[1] * longest[0] / true_scale - 1)
            for true_scale, scale in group
            if (true_scale, scale) != longest
        ]
    if not errors:
        return {}
    return {
        "exposure_ratio_error": float(np.median(errors)),
        "exposure_ratio_error_max": float(np.max(errors)),
    }


def _true_scale(entry: dict[str, Any]) -> float:
    applied = entry["applied"]
    gain = (applied.get("iso") or 100.0) / 100.0
    return float(gain * applied["time"] / (applied.get("f_number") or 1.0) ** 2 * entry.get("light", 1.0))


def _camera_errors(truth: dict[str, Any], calibration: CalibrationRecord) -> dict[str, float]:
    """Gains relative to their geometric mean, and read noise, of the cameras that the truth names."""
    cameras = [camera for camera in calibration.cameras if camera.name in truth["cameras"]]
    errors = {}
    if len(cameras) > 1:
        gains = np.log([[camera.gain, truth["cameras"][camera.name]["gain"]] for camera in cameras])
        gains -= gains.mean(0)
        errors["gain_error"] = float(np.abs(np.expm1(gains[:, 0] - gains[:, 1])).max())
    noise = [
        abs(camera.noise.read_noise / truth["cameras"][camera.name]["noise"]["read_noise"] - 1)
        for camera in cameras
        if camera.noise is not None and truth["cameras"][camera.name]["noise"]["read_noise"] > 0
    ]
    if noise:
        errors["read_noise_error"] = float(max(noise))
    return errors


def response_rmse(session: Path, code_of: Callable[[Array], Array]) -> float | None:
    """RMS distance, in code values 0..1, of a response from the true one, after the best shift in exposure.

    `code_of` maps ln(E k) [M] to codes [M, 3]. None when the truth has no response curve.
    """
    response = store.read_json(session / "truth" / "truth.json").get("response")
    if not response:
        return None
    codes, logs = np.array(response["codes"]), np.array(response["log_exposure"])

    def rmse(shift: float) -> float:
        estimated = np.stack([code_of(logs[channel] + shift)[:, channel] for channel in range(3)])
        return float(np.sqrt(np.mean((estimated - codes) ** 2)))

    low, high = -3.0, 3.0
    for _ in range(6):
        shifts = np.linspace(low, high, 25)
        best = shifts[int(np.argmin([rmse(shift) for shift in shifts]))]
        step = shifts[1] - shifts[0]
        low, high = best - step, best + step
    return rmse(float(best))
