"""SOG, the compressed splats of PlayCanvas (version 2): a zip of lossless WebP pictures and a table.

Each Gaussian is a pixel of every picture. Places are 16 bits of a logarithm, turns and opacities 8; sizes,
colours and harmonics are bytes that name one of 256 float32 values. PlayCanvas and SuperSplat take colours
for sRGB codes, which they decode before they map tones; codes above 1 are light above white. Of linear light
the values lie so that it is near in stops, not in differences, which is what makes 256 of them enough.
https://github.com/playcanvas/splat-transform
"""

import io
import json
import math
import zipfile
from dataclasses import dataclass, replace

import numpy as np
from PIL import Image

from imaging.arrays import Array, Bytes
from imaging.files import store
from imaging.progress import Progress, unreported
from recon.exports.formats.codebook import codebook, nearest
from recon.exports.formats.order import along_curve
from recon.exports.formats.palette import palette
from recon.exports.job import Job, Written
from recon.exports.loss import floor_of
from recon.exports.splats import Splats
from recon.scene.harmonics import C0

_ROW = 64
"""Entries of the palette of harmonics in a row of their picture."""
_OTHERS = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
"""Parts of a quaternion beside its largest."""
DARK = (
    "that its light is linear: PlayCanvas and SuperSplat take it for sRGB codes, and show middle grey 2.7 "
    "stops too dark"
)
"""Note of linear light: the format has no word for it, and readers of today expect codes."""
_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of the files in the zip, so that the same scene gives the same bytes."""


def write(job: Job) -> Written:
    """Write the file, as a writer of `rig export`."""
    splats = job.splats()
    splats = splats.rows(along_curve(splats.means))
    floor = floor_of(job.scene) * splats.factor if splats.linear else 1 / 1024
    packed, held = packed_splats(splats, floor, job.progress)
    store.write_bytes(job.out, packed)
    notes = (DARK,) if splats.linear else ()
    return Written([job.out], held, splats if splats.linear else None, notes)


def packed_splats(splats: Splats, floor: float, progress: Progress = unreported) -> tuple[bytes, Splats]:
    """The file of some Gaussians, one or more, and these as it has them.

    floor: the dimmest colour that matters, in the unit of the colours.
    """
    files: dict[str, Bytes] = {}
    means = _pack_means(splats.means, files)
    quats = _pack_quats(splats.quats, files)
    log_scales = np.log(splats.scales)
    scale_book = codebook(log_scales)
    scale_codes = nearest(log_scales, scale_book)
    files["scales.webp"] = _filled(scale_codes, 255)
    # Colours are coded in stops: by their values, most of the 256 entries would be of bright light.
    stops = _Stops(floor)
    constants = 0.5 + C0 * splats.harmonics[:, 0]
    book = codebook(stops.of(constants))
    colour_codes = nearest(stops.of(constants), book)
    colour_book = ((stops.back(book) - 0.5) / C0).astype(np.float32)
    opacity_codes = np.round(255 * splats.opacities).astype(np.uint8)
    files["sh0.webp"] = np.column_stack([colour_codes, opacity_codes])
    meta = {
        "version": 2,
        "asset": {"generator": "rig"},
        "count": len(splats),
        "means": {
            "mins": means.low.tolist(),
            "maxs": means.high.tolist(),
            "files": ["means_l.webp", "means_u.webp"],
        },
        "scales": {"codebook": scale_book.astype(np.float32).tolist(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": colour_book.tolist(), "files": ["sh0.webp"]},
    }
    pictures = {name: _webp(_picture(pixels)) for name, pixels in files.items()}
    harmonics = colour_book.astype(np.float64)[colour_codes][:, None]
    # The other harmonics share a palette of shapes, as the format has it.
    if splats.degree:
        rest, entry, shapes = _pack_rest(splats, stops, progress)
        meta["shN"] = entry
        pictures |= {name: _webp(shape) for name, shape in shapes.items()}
        harmonics = np.concatenate([harmonics, rest], axis=1)
    # Pictures are compressed already; a fixed date gives the same bytes each time.
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as out:
        for name, data in {"meta.json": json.dumps(meta).encode(), **pictures}.items():
            out.writestr(zipfile.ZipInfo(name, _DATE), data)
    # What is in the file differs from the scene by its codes; the loss is measured on these.
    held = replace(
        splats,
        means=means.held,
        quats=quats,
        scales=np.exp(scale_book.astype(np.float32).astype(np.float64)[scale_codes]),
        opacities=opacity_codes / 255,
        harmonics=harmonics,
    )
    return archive.getvalue(), held


@dataclass(frozen=True)
class _Stops:
    """Numbers of either sign on a scale where a factor of two is a step, as soon as they matter."""

    floor: float

    def of(self, values: Array) -> Array:
        """Convert to arsinh, which is linear below the floor and a logarithm above."""
        return np.arcsinh(values / self.floor)

    def back(self, steps: Array) -> Array:
        """The inverse."""
        return np.asarray(np.sinh(steps) * self.floor)


@dataclass(frozen=True)
class _Means:
    low: Array
    high: Array
    held: Array


def _pack_means(means: Array, files: dict[str, Bytes]) -> _Means:
    """16 bits between the ends, of sign(x) ln(1 + |x|)."""
    bent = np.sign(means) * np.log1p(np.abs(means))
    low, high = bent.min(axis=0), bent.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    codes = np.round(65535 * (bent - low) / span).astype(np.uint16)
    files["means_l.webp"] = _filled((codes & 255).astype(np.uint8), 255)
    files["means_u.webp"] = _filled((codes >> 8).astype(np.uint8), 255)
    decoded = low + span * codes / 65535
    return _Means(low, high, np.sign(decoded) * np.expm1(np.abs(decoded)))


def _pack_quats(quats: Array, files: dict[str, Bytes]) -> Array:
    """The three smaller parts, 8 bits each, and which the largest is, which is made positive."""
    rows, largest = np.arange(len(quats)), np.abs(quats).argmax(axis=1)
    turned = quats * np.where(quats[rows, largest] < 0, -1.0, 1.0)[:, None]
    small = np.take_along_axis(turned, _OTHERS[largest], axis=1)
    codes = np.round(255 * (small * math.sqrt(2) + 1) / 2).clip(0, 255).astype(np.uint8)
    files["quats.webp"] = np.column_stack([codes, (252 + largest).astype(np.uint8)])
    decoded = np.zeros_like(quats)
    small = (codes / 127.5 - 1) / math.sqrt(2)
    np.put_along_axis(decoded, _OTHERS[largest], small, axis=1)
    decoded[rows, largest] = np.sqrt(np.maximum(0, 1 - np.square(small).sum(axis=1)))
    return decoded


def _pack_rest(
    splats: Splats, stops: _Stops, progress: Progress
) -> tuple[Array, dict[str, object], dict[str, Bytes]]:
    """Harmonics above the constant one, by a palette: as held, their entry of the table, their pictures."""
    rest = splats.harmonics[:, 1:]
    count = rest.shape[1]
    bent = stops.of(rest)
    entries, labels = palette(bent.reshape(len(bent), -1), progress)
    entries = entries.reshape(-1, count, 3)
    book = codebook(entries)
    codes = nearest(entries, book)
    values = stops.back(book).astype(np.float32)
    rows = math.ceil(len(entries) / _ROW)
    picture = np.full((rows * _ROW, count, 4), 255, np.uint8)
    picture[: len(entries), :, :3] = codes
    low, high = (labels & 255).astype(np.uint8), (labels >> 8).astype(np.uint8)
    places = np.column_stack([low, high, np.zeros_like(low), np.full_like(low, 255)])
    entry: dict[str, object] = {
        "count": len(entries),
        "bands": splats.degree,
        "codebook": values.tolist(),
        "files": ["shN_centroids.webp", "shN_labels.webp"],
    }
    pictures = {
        "shN_centroids.webp": picture.reshape(rows, _ROW * count, 4),
        "shN_labels.webp": _picture(places),
    }
    return values.astype(np.float64)[codes][labels], entry, pictures


def _filled(codes: Bytes, alpha: int) -> Bytes:
    """Three bytes of each Gaussian and an alpha, uint8 [N, 4]."""
    return np.column_stack([codes, np.full(len(codes), alpha, np.uint8)])


def _picture(pixels: Bytes) -> Bytes:
    """Pixels [N, 4] row by row in a picture about as wide as high, both multiples of 4."""
    width = 4 * math.ceil(math.sqrt(len(pixels)) / 4)
    height = 4 * math.ceil(len(pixels) / width / 4)
    picture = np.zeros((height * width, 4), np.uint8)
    picture[: len(pixels)] = pixels
    return picture.reshape(height, width, 4)


def _webp(picture: Bytes) -> bytes:
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "WEBP", lossless=True, exact=True, method=4)
    return out.getvalue()
