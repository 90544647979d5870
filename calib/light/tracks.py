"""Brightness of each scene point in each view that sees it, and the regions that the points belong to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calib.light.falloff import Tracks
from calib.poses.sfm import SceneModel
from imaging.arrays import Array, Array32, Bytes, Integers, Mask
from imaging.colour.spaces import balanced, rec709_from_camera
from imaging.merge.bracket import Merged
from imaging.optics.lens import Lens
from imaging.sensor.cfa import bilinear
from imaging.session.view_id import ViewId

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Luminance weights of linear Rec.709."""
LEAST_SNR = 10.0
WINDOW = 5
"""px of a picture, over which light is averaged; wider ones are reduced until it suffices."""
WINDOWS = 300
"""Across a wide picture."""


@dataclass(frozen=True, eq=False)
class ViewLight:
    """Smoothed light of a view at a fraction of its pixels, and where it can be trusted.

    luminance: float32 [h, w]; colour: float32 [h, w, 3], camera RGB; trusted: bool [h, w]; vivid: bool
    [h, w], where every channel of the colour can be.
    """

    luminance: Array32
    colour: Array32
    trusted: Mask
    vivid: Mask


def light(merged: Merged, camera_from_rec709: Array | None) -> ViewLight:
    """Luminance of merged radiance; each value is a mean over some pixels, since a corner point lies on
    an edge, where a single pixel says more about its place than about its brightness."""
    if merged.radiance.ndim == 2:
        assert merged.cfa is not None
        interpolated, each = bilinear(np.nan_to_num(merged.radiance), merged.cfa, merged.valid)
        rgb, known = balanced(interpolated, None), np.asarray(each.all(axis=-1))
        step, window = 1, WINDOW
    else:
        step = max(merged.radiance.shape[1] // WINDOWS // WINDOW, 1)
        rgb, known = _reduced(_numbers(merged.radiance), step), _all_of(merged.valid, step)
        window = max(WINDOW, rgb.shape[1] // WINDOWS)
    weights = LUMINANCE
    if camera_from_rec709 is not None:
        weights = LUMINANCE @ rec709_from_camera(camera_from_rec709[:3])
    colour = _mean(rgb.astype(np.float32), window)
    luminance = _mixed(colour, weights)
    least = np.minimum.reduce(cv2.split(colour))
    around = np.ones((window, window), np.uint8)
    trusted = (cv2.erode(_bytes(known), around) > 0) & (luminance > 0)
    vivid = least > 0
    if merged.sigma is not None:
        sigma = merged.sigma if merged.sigma.ndim == 2 else _mixed(merged.sigma, np.full(3, 1 / 3))
        sigma = _reduced(np.minimum(_numbers(sigma), np.float32(1e30)), step) / np.float32(step)
        noise = _mean(sigma, window) / window
        trusted &= luminance > LEAST_SNR * noise
        # Red and blue have a quarter of the sites, hence twice the noise.
        vivid &= least > 2 * LEAST_SNR * noise
    return ViewLight(luminance, colour, np.asarray(trusted), np.asarray(trusted & vivid))


def _numbers(picture: Array32) -> Array32:
    """A copy with 0 where there is no number."""
    copy = np.array(picture, np.float32)
    cv2.patchNaNs(copy.reshape(len(copy), -1), 0.0)
    return copy


def _reduced(picture: Array32, step: int) -> Array32:
    """The means of a picture [h, w] or [h, w, C] over squares of `step` px; what is over is left out."""
    if step == 1:
        return picture
    height, width = picture.shape[0] // step, picture.shape[1] // step
    part = picture[: height * step, : width * step]
    return np.asarray(cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA), np.float32)


def _all_of(valid: Mask, step: int) -> Mask:
    """Return where every channel of every pixel of a square of `step` px is valid."""
    every = np.logical_and.reduce(cv2.split(_bytes(valid)))
    height, width = every.shape[0] // step, every.shape[1] // step
    if step > 1:
        every = every[: height * step, : width * step].reshape(height, step, width, step).all(axis=(1, 3))
    return np.asarray(every)


def _bytes(mask: Mask) -> Bytes:
    """A mask as OpenCV takes it."""
    return np.ascontiguousarray(mask).view(np.uint8)


def _mixed(picture: Array32, weights: Array) -> Array32:
    """The weighted sum [h, w] of the channels of a picture [h, w, C]."""
    return np.asarray(cv2.transform(picture, weights[None].astype(np.float32)), np.float32)


def _mean(picture: Array32, window: int) -> Array32:
    """The mean of a picture [h, w] or [h, w, C] over squares; beyond its border it is mirrored."""
    mean = cv2.blur(np.ascontiguousarray(picture), (window, window), borderType=cv2.BORDER_REFLECT)
    return np.asarray(mean, np.float32)


def brightness_at(view: ViewLight, points: Array, width: int, height: int) -> Array:
    """Natural log of luminance at points [K, 2] of a picture of `width` x `height`; NaN where not trusted."""
    row, column = _sites(view, points, width, height)
    value = np.where(view.trusted[row, column], view.luminance[row, column], np.nan)
    return np.asarray(np.log(value), np.float64)


def colour_at(view: ViewLight, points: Array, width: int, height: int) -> Array:
    """Natural log of camera RGB [K, 3] at points, as `brightness_at`; NaN where a channel is not trusted."""
    row, column = _sites(view, points, width, height)
    value = np.where(view.vivid[row, column, None], view.colour[row, column], np.nan)
    return np.asarray(np.log(value), np.float64)


def _sites(
    view: ViewLight, points: Array, width: int, height: int
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    rows, columns = view.luminance.shape
    row = np.clip((points[:, 1] * rows / height).astype(np.intp), 0, rows - 1)
    column = np.clip((points[:, 0] * columns / width).astype(np.intp), 0, columns - 1)
    return row, column


@dataclass(frozen=True, eq=False)
class Observations:
    """Observations of scene points; rows are observations, in order of points and views.

    point: int [N], which scene point; view: int [N], of `views`; feature: int [N], of that view; radius:
    float64 [N], 1 at the corner of the image; direction: float64 [N, 3], unit, from the point to the camera;
    region: int [N], the region of the scene that the point lies in.
    """

    views: list[ViewId]
    point: Integers
    view: Integers
    feature: Integers
    radius: Array
    direction: Array
    region: Integers

    def values(self, of_features: Mapping[ViewId, Array]) -> Array:
        """Gather the values that views hold of each of their features, [K] or [K, C], at the observed ones:
        [N, ...].
        """
        first_view = self.views[self.view[0]] if len(self.view) else next(iter(of_features))
        values = np.empty((len(self.point), *of_features[first_view].shape[1:]))
        for number, view in enumerate(self.views):
            rows = self.view == number
            if rows.any():
                values[rows] = of_features[view][self.feature[rows]]
        return values


def point_observations(model: SceneModel, usable: Mapping[ViewId, Mask]) -> Observations:
    """Collect the observations of all scene points that two views or more see; usable: bool [K], which
    features of a view count.
    """
    images = {index: model.reconstruction.image(index) for index in model.reconstruction.reg_image_ids()}
    views = sorted(ViewId.of_image(image.name) for image in images.values())
    number = {index: views.index(ViewId.of_image(image.name)) for index, image in images.items()}
    centres = {index: np.asarray(image.projection_center()) for index, image in images.items()}
    rows: list[tuple[int, int, int, float]] = []
    towards: list[Array] = []
    order = sorted(model.reconstruction.points3D)
    for index, point in enumerate(order):
        track = model.reconstruction.points3D[point].track
        for element in sorted(track.elements, key=lambda one: one.image_id):
            view = views[number[element.image_id]]
            if usable[view][element.point2D_idx]:
                x, y = np.ravel(images[element.image_id].point2D(element.point2D_idx).xy)
                radius = _radius(x, y, model.lenses[view.camera])
                rows.append((index, number[element.image_id], element.point2D_idx, radius))
                towards.append(centres[element.image_id] - model.reconstruction.points3D[point].xyz)
    table = np.array(rows, np.float64).reshape(-1, 4)
    direction = np.array(towards, np.float64).reshape(-1, 3)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    point, view, feature = table[:, :3].astype(np.int64).T
    shared_rows = np.bincount(point, minlength=1)[point] >= 2
    shared, place_of = np.unique(point[shared_rows], return_inverse=True)
    places = np.array([model.reconstruction.points3D[index].xyz for index in order])[shared]
    region = regions_of(places.reshape(-1, 3))[place_of]
    return Observations(
        views,
        point[shared_rows],
        view[shared_rows],
        feature[shared_rows],
        table[shared_rows, 3],
        direction[shared_rows],
        region,
    )


def tracks_of(model: SceneModel, brightness: Mapping[ViewId, Array], cameras: Sequence[str]) -> Tracks:
    """Observations of all scene points that two views or more see well, in order of points and views.

    brightness: of each feature of each view, as `brightness_at` gives it; cameras: names, in the order that
    `Tracks.camera` counts.
    """
    observations = point_observations(
        model, {view: np.isfinite(values) for view, values in brightness.items()}
    )
    camera = np.array([cameras.index(view.camera) for view in observations.views], np.int64)
    return Tracks(
        observations.point,
        camera[observations.view],
        observations.radius,
        observations.values(brightness),
        observations.direction,
        observations.region,
    )


def _radius(x: float, y: float, lens: Lens) -> float:
    """Distance from the centre of the image, 1 at its corner."""
    return float(
        np.hypot(x - lens.width / 2, y - lens.height / 2) / np.hypot(lens.width / 2, lens.height / 2)
    )


REGIONS = 20
FEWEST = 12
"""Points of a region, below which there are fewer regions."""
SPAN = (0.1, 0.9)
"""Quantiles between which a region is measured, so that stray points do not make it long."""


def regions_of(places: Array) -> Integers:
    """Number of the region of each point, int64 [N]: boxes of about as many points each.

    Regions have to agree before light is corrected for all of a scene. Points that lie side by side belong to
    one surface, and its sheen, its slope and its shadow change with the direction alike in all of them:
    thousands of such points are one witness. What a camera does to a photograph it does to all regions.

    places: of the points, float64 [N, 3], in any unit. The largest box is halved along its longest side until
    there are enough.
    """
    boxes = [np.arange(len(places))]
    while len(boxes) < min(REGIONS, len(places) // FEWEST):
        boxes.sort(key=len)
        largest = boxes.pop()
        low, high = np.quantile(places[largest], SPAN, axis=0)
        order = largest[np.argsort(places[largest, int((high - low).argmax())], kind="stable")]
        boxes += [order[: len(order) // 2], order[len(order) // 2 :]]
    region = np.zeros(len(places), np.int64)
    for number, box in enumerate(boxes):
        region[box] = number
    return region
