"""Motion between two exposures of one view: the shift, and the moved pixels.

The shift is that of Lucas and Kanade ("An iterative image registration technique", IJCAI 81), coarse to
fine, on the logarithm of light, in which another exposure is a constant.
"""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from capture.pictures.reduced_pictures import ReducedPicture
from imaging.arrays import Array, Array32, Mask

DARKEST, BRIGHTEST = 0.02, 0.9
"""Levels of the longer exposure between which the two are compared."""
CLEAR = 5.0
"""Standard deviations that the light has in the shorter exposure."""
FEWEST = 0.04
"""Share of the picture that both must show."""
LEVELS = (16, 8, 4, 2, 1)
"""Samples that are averaged, from coarse to fine."""
ENOUGH = 1 << 20
"""Samples that determine a shift well enough; of larger pictures the finest levels are left out."""
BLOCK = 4
"""Side of the blocks, in samples, in which something may have moved."""
DIFFERENT, DEVELOPED = 0.15, 0.3
"""Difference, natural log, from which a block shows something else; less is flicker, or development."""
FAINTEST = 0.006
"""Level of the shorter exposure, where a camera developed it: below are few codes, and colours clipped."""
SURE = 6.0
"""Standard deviations of the same."""
TILES = 4
BINS = 64
"""Levels at which the development of two photographs is matched."""


@dataclass(frozen=True)
class Motion:
    """shift: pixels of the picture, x and y, of the shorter against the longer; error: of its length.

    moved: share of what both show that is something else in one of them, once shifted back.
    """

    shift: tuple[float, float]
    error: float
    moved: float

    @property
    def length(self) -> float:
        """Pixels."""
        return float(np.hypot(*self.shift))


class _Pair(NamedTuple):
    """Logarithms of light of the longer and the shorter, standard deviation of their difference, where."""

    long: Array32
    short: Array32
    sigma: Array32
    usable: Mask
    different: float


def compare(longer: ReducedPicture, shorter: ReducedPicture) -> Motion | None:
    """Compare two exposures of one view; None where they share too little."""
    pair = _pair(longer, shorter)
    if pair is None:
        return None
    measured = _shift(pair, np.zeros(2))
    if measured is None:
        return None
    if shorter.patches is not None:
        pair = _matched(pair, longer.green, shorter.green, np.array(measured[0]))
        measured = _shift(pair, np.array(measured[0])) or measured
    shift, error = measured
    # Samples are two pixels wide.
    return Motion((2 * shift[0], 2 * shift[1]), 2 * error, _moved(pair, shift))


def _pair(longer: ReducedPicture, shorter: ReducedPicture) -> _Pair | None:
    if longer.green.shape != shorter.green.shape or min(longer.green.shape) < 16:
        return None
    long, short = (cv2.GaussianBlur(picture.green, (0, 0), 1.0) for picture in (longer, shorter))
    clipped = cv2.dilate((longer.clipped | shorter.clipped).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    usable = ~clipped & (long > DARKEST) & (long < BRIGHTEST)
    if usable.mean() < FEWEST:
        return None
    ratio = float(np.median(long[usable]) / max(float(np.median(short[usable])), 1e-9))
    expected = long / ratio
    # Chosen by the longer, whose noise the shorter does not share; the blur averages 4 pi samples.
    spread = np.sqrt(shorter.noise.variance(expected) / (4 * np.pi))
    usable &= expected > np.maximum(CLEAR * spread, 0.0 if shorter.patches is None else FAINTEST)
    if usable.mean() < FEWEST:
        return None
    relative = np.hypot(spread / np.maximum(expected, 1e-6), _relative(longer, long))
    logs = [np.log(np.maximum(light, 1e-6)) for light in (long, short)]
    different = DIFFERENT if shorter.patches is None else DEVELOPED
    return _Pair(logs[0], logs[1], relative.astype(np.float32), usable, different)


def _relative(picture: ReducedPicture, light: Array32) -> Array32:
    return np.asarray(
        np.sqrt(picture.noise.variance(light) / (4 * np.pi)) / np.maximum(light, 1e-6), np.float32
    )


def _matched(pair: _Pair, long: Array32, short: Array32, shift: Array) -> _Pair:
    """The pair with the shorter developed as the longer is, by the curve of medians between their codes."""
    there, usable = _moved_back(pair._replace(short=short), shift)
    edges = np.unique(np.quantile(there[usable], np.linspace(0.0, 1.0, BINS + 1)))
    place = np.clip(np.searchsorted(edges, there[usable]) - 1, 0, max(len(edges) - 2, 0))
    values, codes = long[usable], there[usable]
    bins = [place == index for index in range(len(edges) - 1) if np.any(place == index)]
    if len(bins) < 3:
        return pair
    middles = [float(np.median(codes[chosen])) for chosen in bins]
    medians = np.maximum.accumulate([float(np.median(values[chosen])) for chosen in bins])
    # Before it is blurred, as the longer is: blurring does not commute with a curve.
    light = np.asarray(np.interp(short, middles, medians), np.float32)
    return pair._replace(short=np.log(np.maximum(cv2.GaussianBlur(light, (0, 0), 1.0), 1e-6)))


def _shift(pair: _Pair, start: Array) -> tuple[tuple[float, float], float] | None:
    """Shift in samples, and the standard error of its length from how parts of the picture scatter."""
    shift = start
    error = np.inf
    for level in LEVELS:
        if min(pair.long.shape) < 16 * level:
            continue
        if level < LEVELS[0] and pair.long.size > 4 * level**2 * ENOUGH:
            break
        part = _averaged(pair, level)
        at = shift / level
        for _ in range(4):
            step = _step(part, at)
            if step is None:
                break
            at, error = at + step[0], step[1] * level
            if np.hypot(*step[0]) < 0.01:
                break
        if np.all(np.isfinite(at)) and np.hypot(*at) * level < 0.1 * max(pair.long.shape):
            shift = at * level
    if not np.isfinite(error):
        return None
    return (float(shift[0]), float(shift[1])), float(error)


def _averaged(pair: _Pair, level: int) -> _Pair:
    if level == 1:
        return pair
    height, width = (side // level for side in pair.long.shape)

    def small(image: Array32) -> Array32:
        cut = np.asarray(image[: height * level, : width * level], np.float32)
        return np.asarray(cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA), np.float32)

    usable = small(pair.usable.astype(np.float32)) > 0.999
    return _Pair(small(pair.long), small(pair.short), small(pair.sigma), usable, pair.different)


def _step(pair: _Pair, shift: Array) -> tuple[Array, float] | None:
    """One step of the shift, and its standard error, over tiles."""
    short, usable = _moved_back(pair, shift)
    usable = cv2.erode(usable.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    if usable.sum() < 60:
        return None
    right = cv2.Sobel(pair.long, cv2.CV_32F, 1, 0, scale=1 / 8)
    down = cv2.Sobel(pair.long, cv2.CV_32F, 0, 1, scale=1 / 8)
    residual = pair.long - short
    residual -= np.median(residual[usable])
    sigma = np.hypot(pair.sigma, 0.02)
    size = np.abs(residual) / sigma
    robust = 3.0 * max(float(np.median(size[usable])), 1e-3)
    weight = np.where(usable, np.minimum(1.0, robust / np.maximum(size, 1e-9)) / sigma**2, 0.0)
    rows, columns = np.nonzero(usable)
    high, wide = usable.shape
    tile = (rows * TILES // high) * TILES + columns * TILES // wide
    weights = weight[usable]
    design = np.stack([right[usable], down[usable], np.ones(len(weights), np.float32)], 1).astype(np.float64)
    normal, goal = np.zeros((TILES * TILES, 3, 3)), np.zeros((TILES * TILES, 3))
    for index in np.unique(tile):
        mine = tile == index
        weighted = design[mine] * weights[mine, None]
        normal[index] = design[mine].T @ weighted
        goal[index] = weighted.T @ residual[usable][mine]
    total = normal.sum(0)
    try:
        inverse = np.linalg.inv(total + 1e-9 * np.trace(total) * np.eye(3))
    except np.linalg.LinAlgError:
        return None
    # The shorter shows at x + shift what the longer shows at x; its residual is minus gradient times shift.
    step = inverse @ goal.sum(0)
    scatter = goal - normal @ step
    covariance = inverse @ (scatter.T @ scatter) @ inverse
    return step[:2], float(np.sqrt(max(covariance[0, 0] + covariance[1, 1], 0.0)))


def _moved_back(pair: _Pair, shift: Array) -> tuple[Array32, Mask]:
    """The shorter exposure at the places of the longer one, and where both are usable."""
    if not np.any(shift):
        return pair.short, pair.usable
    height, width = pair.long.shape
    matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    short = cv2.warpAffine(pair.short, matrix, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    inside = cv2.warpAffine(np.ones((height, width), np.float32), matrix, (width, height), flags=flags)
    return np.asarray(short, np.float32), np.asarray(pair.usable & (inside > 0.999))


def _moved(pair: _Pair, shift: tuple[float, float]) -> float:
    """Share of the blocks that differ by more than noise, shifted back; single blocks do not count."""
    short, usable = _moved_back(pair, np.array(shift))
    height, width = (side // BLOCK * BLOCK for side in usable.shape)

    def blocks(image: npt.NDArray[np.generic]) -> Array:
        cut = image[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK)
        return np.asarray(cut.mean((1, 3), dtype=np.float64))

    share = blocks(usable)
    reliable = share > 0.6
    if not reliable.any():
        return 0.0
    inside = np.maximum(share, 1e-9)
    difference = blocks(np.where(usable, pair.long - short, 0.0)) / inside
    difference -= np.median(difference[reliable])
    # The blur before makes neighbours alike: a block holds fewer samples than it has.
    noise = blocks(np.where(usable, pair.sigma, 0.0)) / inside
    other = reliable & (np.abs(difference) > np.maximum(pair.different, SURE * noise))
    company = cv2.filter2D(other.astype(np.float32), -1, np.ones((3, 3), np.float32)) >= 3
    return float((other & company).sum() / reliable.sum())
