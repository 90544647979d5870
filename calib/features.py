"""Features of every view and what of them two views share, written to a COLMAP database in memory."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from calib.previews import enlargement
from imaging.colmap import pycolmap

Float = npt.NDArray[np.float32]
Progress = Callable[[str, int, int], None]
Key = tuple[str, int]
"""Camera name and frame."""

PEAK_THRESHOLD = 0.002
"""Of SIFT; the usual 0.0067 leaves too few features in 320 pixels and costs a third of a degree."""
MOST_FEATURES = 6000
RATIO = 0.8
"""Lowe's ratio of nearest to second nearest, angles between descriptors."""
FARTHEST = 0.7
"""Largest angle between descriptors that match, radians."""
FEWEST_MATCHES = 15


@dataclass(frozen=True, eq=False)
class Features:
    """points: float64 [K, 2], preview pixels, centres at +0.5; descriptors: float32 [K, 128], unit length."""

    points: npt.NDArray[np.float64]
    descriptors: Float


@dataclass(frozen=True)
class Pair:
    """Two views that share matches: how many, how many fit an epipolar geometry, how many a homography."""

    matches: int
    inliers: int
    planar: float
    """Share of the inliers that a single homography explains as well: near 1 for a pure rotation."""


def extract(pictures: Mapping[Key, Float], threads: int, progress: Progress) -> dict[Key, Features]:
    """SIFT features of pictures, float32 [h, w] in 0..1."""
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = threads
    options.use_gpu = False
    options.sift.peak_threshold = PEAK_THRESHOLD
    options.sift.max_num_features = MOST_FEATURES
    extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
    found = {}
    for done, (key, picture) in enumerate(pictures.items()):
        progress("finding features", done, len(pictures))
        scale = enlargement(picture.shape[1])
        if scale > 1:
            picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
        picture = np.ascontiguousarray(np.clip(picture, 0.0, 1.0), np.float32)
        keypoints, descriptors = extractor.extract_from_float32_array(picture)
        points = np.array(pycolmap.keypoints_to_matrix(keypoints), np.float64).reshape(-1, 4)[:, :2]
        vectors = np.asarray(descriptors.data).astype(np.float32).reshape(len(points), -1)
        vectors /= np.linalg.norm(vectors, axis=1, keepdims=True) + 1e-9
        found[key] = Features(points / scale, vectors)
    progress("finding features", len(pictures), len(pictures))
    return found


def match(one: Features, other: Features) -> npt.NDArray[np.uint32]:
    """Pairs of indices [M, 2] of features that are each other's nearest, by Lowe's ratio test both ways.

    One matrix product per pair of views: many times faster on a CPU than COLMAP's own matcher.
    """
    if len(one.points) < 2 or len(other.points) < 2:
        return np.empty((0, 2), np.uint32)
    cosine = one.descriptors @ other.descriptors.T
    rows, columns = np.arange(len(cosine)), np.arange(cosine.shape[1])
    right, back = cosine.argmax(1), cosine.argmax(0)
    best, best_back = cosine[rows, right], cosine[back, columns]
    cosine[rows, right] = -1
    second = cosine.max(1)
    cosine[rows, right] = best
    cosine[back, columns] = -1
    second_back = cosine.max(0)

    def angle(value: Float) -> Float:
        return np.asarray(np.arccos(np.clip(value, -1, 1)), np.float32)

    good = (angle(best) < FARTHEST) & (angle(best) < RATIO * angle(second))
    good_back = angle(best_back) < RATIO * angle(second_back)
    keep = good & (back[right] == rows) & good_back[right]
    return np.stack([rows[keep], right[keep]], axis=1).astype(np.uint32)


def fill_database(
    database: Any,
    cameras: Mapping[str, Any],
    features: Mapping[Key, Features],
    max_error: float,
    progress: Progress,
) -> dict[tuple[Key, Key], Pair]:
    """Write cameras, images and verified matches of all pairs of views; returns the pairs that match.

    cameras: pycolmap cameras by name; their `camera_id` is set here. Every camera is a rig of its own
    for now, every image a frame. max_error: of the epipolar geometry, px.
    """
    images: dict[Key, int] = {}
    rigs: dict[str, int] = {}
    for name, camera in cameras.items():
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera.camera_id))
        rigs[name] = database.write_rig(rig)
    for (name, frame), own in features.items():
        image = pycolmap.Image()
        image.name = f"{name}/{frame:04d}.png"
        image.camera_id = cameras[name].camera_id
        index = images[name, frame] = database.write_image(image)
        instant = pycolmap.Frame()
        instant.rig_id = rigs[name]
        instant.add_data_id(database.read_image(index).data_id)
        database.write_frame(instant)
        database.write_keypoints(index, own.points.astype(np.float32))
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    options.ransac.max_error = max_error
    options.detect_watermark = False
    pairs = {}
    every = list(combinations(features, 2))
    for done, (a, b) in enumerate(every):
        progress("matching", done, len(every))
        matches = match(features[a], features[b])
        if len(matches) < FEWEST_MATCHES:
            continue
        geometry = pycolmap.estimate_two_view_geometry(
            cameras[a[0]], features[a].points, cameras[b[0]], features[b].points, matches, options
        )
        database.write_matches(images[a], images[b], matches)
        inliers = len(geometry.inlier_matches)
        if inliers >= FEWEST_MATCHES:
            database.write_two_view_geometry(images[a], images[b], geometry)
            pairs[a, b] = Pair(len(matches), inliers, _planar(features[a], features[b], geometry, max_error))
    progress("matching", len(every), len(every))
    return pairs


def _planar(one: Features, other: Features, geometry: Any, max_error: float) -> float:
    index = np.asarray(geometry.inlier_matches)
    source, target = one.points[index[:, 0]], other.points[index[:, 1]]
    cv2.setRNGSeed(0)
    _, mask = cv2.findHomography(source, target, cv2.RANSAC, max_error)
    return 0.0 if mask is None else float(np.mean(mask))
