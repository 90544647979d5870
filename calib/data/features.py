"""Features of every view and what of them two views share, written to a COLMAP database in memory."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from calib.data import learned
from calib.data.matching import match, multiplies_bytes
from calib.data.pairs import pairs_to_match
from calib.data.previews import enlargement
from calib.data.unfinished import Unfinished
from imaging.arrays import AnyArray, Array, Array32, Mask
from imaging.compute.threads import in_turn
from imaging.files.colmap import pycolmap
from imaging.progress import Progress
from imaging.session.view_id import ViewId

PEAK_THRESHOLD = 0.002
"""Peak threshold of SIFT; the usual 0.0067 leaves too few features in 320 pixels and costs a third of a
degree.
"""
FeatureKind = Literal["sift", "more", "learned"]
"""SIFT's features, more of them, and learned ones."""
MOST_FEATURES = 6000
"""Most features in one picture, the largest; matching takes time by their square."""
MORE_FEATURES, ENOUGH_OF_MORE = 10_000, 8_000
"""The same where the usual number leaves many views without a pose: of every third of 18 photographs of a
flight (`brighton`) none is placed by 6,000 and all six by 10,000."""
ENOUGH_FEATURES = 4500
"""Number of features with which a picture is not searched at twice its size for smaller ones."""
PIXELS_ENOUGH, SMALL = 72, 100_000
"""The same number by pixels, of pictures with as many as SMALL: brackets of metal and glass, 400 px wide, are
placed within 0.010 degrees by half of the features, in a third of the processor seconds, and within 0.007 by
all of them."""
PIXELS_EACH = 36
"""Pixels of a small picture for each feature: more of them are noise."""
FEWEST_MATCHES = 15
PLANAR_SHARE = 0.85
"""Share of a pair's matches that one homography explains, above which they show a plane or a rotation."""
TRIALS = 200
"""Most samples of four matches that are tried for such a homography: where that share fits, every second
sample has none but such, and a pair that no homography explains takes a tenth of the time of OpenCV's 2,000.
"""


@dataclass(frozen=True, eq=False)
class Features:
    """points: float64 [K, 2], preview pixels, centres at +0.5; descriptors: [K, 128], SIFT's are uint8,
    learned ones float32. kind: as `find` was asked for."""

    points: Array
    descriptors: AnyArray
    kind: FeatureKind = "sift"


@dataclass(frozen=True)
class MatchedPair:
    """Two views that share matches: points [M, 2] of each, px, that fit an epipolar geometry.

    index: uint32 [M, 2], their places among the features of each view.
    """

    one: Array
    other: Array
    index: npt.NDArray[np.uint32]

    def parallax(self, size: tuple[int, int], max_error: float) -> float:
        """Return how far the matches are from those of a camera that only turns: 0 for a pure rotation.

        A turn moves the picture by a homography `K R K^-1`; a flat scene seen from two places by one
        that no focal length makes a rotation. inf where no homography explains the matches. size: of
        the pictures, px.
        """
        cv2.setRNGSeed(0)
        homography, mask = cv2.findHomography(self.one, self.other, cv2.RANSAC, max_error, maxIters=TRIALS)
        if homography is None or float(np.mean(mask)) < PLANAR_SHARE:
            return float("inf")
        cameras = np.tile([[0, 0, size[0] / 2], [0, 0, size[1] / 2], [0, 0, 1]], (300, 1, 1))
        cameras[:, [0, 1], [0, 1]] = max(size) * np.geomspace(0.4, 5.0, 300)[:, None]
        values = np.linalg.svd(np.linalg.inv(cameras) @ homography @ cameras, compute_uv=False)
        return float(np.min(values[:, 0] / np.maximum(values[:, 2], 1e-12) - 1))


def find(picture: Array32, kind: FeatureKind) -> Features:
    """Find the features of one picture, float32 [h, w] in 0..1."""
    if kind == "learned":
        return Features(*learned.extract(picture), kind)
    if kind == "more":
        return replace(extract(picture, MORE_FEATURES, ENOUGH_OF_MORE), kind=kind)
    return extract(picture, enough=enough_features(picture.size))


def enough_features(pixels: int) -> int:
    """Number of features with which a picture of that many pixels is not searched at twice its size."""
    return ENOUGH_FEATURES if pixels < SMALL else min(ENOUGH_FEATURES, pixels // PIXELS_ENOUGH)


def extract(picture: Array32, most: int = MOST_FEATURES, enough: int = ENOUGH_FEATURES) -> Features:
    """Find SIFT features of one picture, float32 [h, w] in 0..1, `most` at most.

    enough: number with which a picture is not searched at twice its size.
    """
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = 1
    options.use_gpu = False
    options.sift.peak_threshold = PEAK_THRESHOLD
    places_at_most = options.sift.max_num_features = min(most, max(picture.size // PIXELS_EACH, 500))
    scale = enlargement(picture.shape[1], picture.shape[0])
    if scale > 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    picture = np.ascontiguousarray(np.clip(picture, 0.0, 1.0), np.float32)
    # COLMAP drops whole octaves of the smallest features, as long as enough are left: most pictures of
    # full size are searched for little at twice their size, which takes four times as long.
    for octave in (0, -1):
        options.sift.first_octave = octave
        extractor = pycolmap.FeatureExtractor.create(options, pycolmap.Device.cpu)
        keypoints, descriptors = extractor.extract_from_float32_array(picture)
        if len(keypoints) >= min(places_at_most, enough):
            break
    places = np.array(pycolmap.keypoints_to_matrix(keypoints), np.float64).reshape(-1, 4)
    vectors = np.asarray(descriptors.data, np.uint8).reshape(len(places), 128)
    if len(places) > most:
        # SIFT counts places, of which those with two orientations are two features each.
        largest = np.sort(np.argsort(-places[:, 2], kind="stable")[:most])
        places, vectors = places[largest], vectors[largest]
    return Features(places[:, :2] / scale, vectors)


def _matched(
    one: Features, other: Features, sides: tuple[Any, Any], *, by_bytes: bool = False
) -> npt.NDArray[np.uint32]:
    """Pairs of indices [M, 2] of features of two pictures; sides: their pycolmap cameras."""
    if one.kind != "learned":
        return match(one.descriptors, other.descriptors, by_bytes=by_bytes)
    sizes = tuple((camera.width, camera.height) for camera in sides)
    return learned.match(
        (one.points, one.descriptors), (other.points, other.descriptors), (sizes[0], sizes[1])
    )


def unmasked(features: Features, counts: Mask, width: int, height: int) -> Features:
    """The features of a picture that a mask lets through.

    Args:
        features: Features, px of the picture.
        counts: Mask of the pixels that count, bool [H, W], of the photograph, of which the picture is a
            smaller or an equal one.
        width: Width of the picture, px.
        height: Its height, px.

    Returns:
        The features at pixels that count.
    """
    scale = counts.shape[1] / width, counts.shape[0] / height
    x, y = (features.points * scale).astype(int).T
    keep = counts[y.clip(0, counts.shape[0] - 1), x.clip(0, counts.shape[1] - 1)]
    return (
        features if keep.all() else Features(features.points[keep], features.descriptors[keep], features.kind)
    )


def _write_views(
    database: Any, cameras: Mapping[str, Any], features: Mapping[ViewId, Features]
) -> dict[ViewId, int]:
    """Write cameras, rigs of one each, and images with their features.

    Returns:
        The number of each image.
    """
    images: dict[ViewId, int] = {}
    rigs: dict[str, int] = {}
    for name, camera in cameras.items():
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera.camera_id))
        rigs[name] = database.write_rig(rig)
    for view, view_features in features.items():
        image = pycolmap.Image()
        image.name = view.image_name
        image.camera_id = cameras[view.camera].camera_id
        index = images[view] = database.write_image(image)
        instant = pycolmap.Frame()
        instant.rig_id = rigs[view.camera]
        instant.add_data_id(database.read_image(index).data_id)
        database.write_frame(instant)
        database.write_keypoints(index, view_features.points.astype(np.float32))
    return images


def fill_database(
    database: Any,
    cameras: Mapping[str, Any],
    features: Mapping[ViewId, Features],
    max_error: float,
    tied: Sequence[Collection[str]],
    unfinished: Unfinished,
    progress: Progress,
) -> dict[tuple[ViewId, ViewId], MatchedPair]:
    """Write cameras, images and verified matches of pairs of views.

    Every camera is a rig of its own here, every image a frame; a common rig is found from their poses later.

    Args:
        database: pycolmap's, which is written to.
        cameras: pycolmap cameras by name; their `camera_id` is set here.
        features: Features of each view, px of its picture.
        max_error: Largest miss of a match by the epipolar geometry, px.
        tied: Names of cameras that are mounted to each other, a collection for each rig.
        unfinished: Store of the matches of an earlier run, to which new ones are added.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The pairs of views that match, with the matches that fit their geometry.

    Raises:
        StorageError: The disk refuses to keep matches.
    """
    images = _write_views(database, cameras, features)
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.random_seed = 0
    options.ransac.max_error = max_error
    options.detect_watermark = False
    pairs = {}
    every = pairs_to_match(
        {view: view_features.descriptors for view, view_features in features.items()}, tied
    )

    by_bytes = multiplies_bytes(sum(len(features[a].points) * len(features[b].points) for a, b in every))

    def key_of(a: ViewId, b: ViewId) -> str:
        """The name under which matches of a pair are kept."""
        return f"{features[a].kind} {a} {b}"

    def geometry_of(number: int) -> tuple[npt.NDArray[np.uint32], Any]:
        """Matches of a pair and the geometry that they fit; None where they are too few."""
        a, b = every[number]
        one, other = features[a], features[b]
        matches = unfinished.small(key_of(a, b))
        if matches is None:
            matches = _matched(one, other, (cameras[a.camera], cameras[b.camera]), by_bytes=by_bytes)
        if len(matches) < FEWEST_MATCHES:
            return matches, None
        return matches, pycolmap.estimate_two_view_geometry(
            cameras[a.camera], one.points, cameras[b.camera], other.points, matches, options
        )

    try:
        for done, (matches, geometry) in enumerate(in_turn(len(every), geometry_of)):
            progress("matching", done, len(every))
            a, b = every[done]
            unfinished.keep(key_of(a, b), matches)
            if geometry is None:
                continue
            database.write_matches(images[a], images[b], matches)
            inliers = np.asarray(geometry.inlier_matches)
            if len(inliers) >= FEWEST_MATCHES:
                database.write_two_view_geometry(images[a], images[b], geometry)
                one, other = features[a].points[inliers[:, 0]], features[b].points[inliers[:, 1]]
                pairs[a, b] = MatchedPair(one, other, inliers)
    finally:
        unfinished.flush()
    progress("matching", len(every), len(every))
    return pairs
