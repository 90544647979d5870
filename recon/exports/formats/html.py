"""A page that shows the scene at any exposure in any browser: one file, which loads nothing.

The programs of `viewer/` draw as `rig` does, with its blur, its cut-offs and the distances that the
Gaussians were trained at, and blend linear light in floats; an exposure and a map of tones come after that.
The numbers of a Gaussian are 16 bits each between the least and the largest of the scene, of light on a
scale that is even in stops, of places 21 bits; harmonics above the constant one are bytes that name one of
256 values. WebGL 2 (Khronos 2017), and splats as instances sorted by a worker: Kerbl et al. 2023, arXiv
2308.04079.
"""

import base64
import json
import math
import re
import zlib
from dataclasses import dataclass, replace
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np
import numpy.typing as npt

from imaging.arrays import AnyArray, Array, Bytes
from imaging.errors import ReconstructionError
from imaging.files import store
from imaging.optics.pose import as_held
from recon.exports.formats.codebook import codebook, nearest
from recon.exports.formats.order import along_curve
from recon.exports.job import Job, Written, lens_note
from recon.exports.loss import floor_of
from recon.exports.splats import Splats, far_light_of
from recon.result.display import in_colour
from recon.result.first_look import Beginning, beginning, shot_at
from recon.result.model import SceneView
from recon.result.scene import Scene
from recon.result.splats.splat_files import what_is_shown
from recon.scene.harmonics import C0, COEFFICIENTS, DEGREE

_PARTS = (
    *("page.css", "splat.vert", "splat.frag", "whole.vert", "sky.frag", "tones.frag", "bright.wgsl"),
    *("sort.js", "draw.js", "camera.js", "bright.js", "main.js"),
)
_FINE = 32
"""Steps of a place between two codes of 16 bits."""
_SOLID = 20.0
"""Logit of an opacity that float32 has as 1, and its negative one that no renderer draws."""
_FAR = 30.0
"""Natural log of a distance that is as good as infinite, in scene units."""


def write(job: Job) -> Written:
    """Write the file, as a writer of `rig export`; ReconstructionError for a scene without views, where the
    page could not begin.
    """
    scene = job.scene
    if not scene.views:
        raise ReconstructionError(
            f"{scene.folder} has no views, at which a page begins: export another format."
        )
    splats = job.splats(with_dome=False)
    order = along_curve(splats.means)
    sampling = scene.renderer.sampling
    least, most = np.zeros(len(splats)), np.full(len(splats), np.inf)
    if sampling is not None:
        least, most = sampling.least.double().numpy(), sampling.most.double().numpy()
    packed = packed_splats(splats.rows(order), least[order], most[order], floor_of(scene) * splats.factor)
    store.write_bytes(job.out, _page(job, packed).encode())
    return Written([job.out], packed.held, splats.rows(order), lens_note(scene))


@dataclass(frozen=True, eq=False)
class Packed:
    """Gaussians as the page has them.

    codes: uint16 [N, 16], of means in scene coordinates, opacity logit; log scales, ln least spacing; x, y, z
    of the turn, ln most spacing; light, and five bits more of each mean. low, grain: a value of the 16 is
    low + grain * code. Means are sign(x) ln(1 + |x|), light its arsinh in units of `faint`: a step is a share
    of what is bright, and not of what does not matter. rest: uint8 [N, 8, 3], of the book, or [0, 8, 3].
    """

    codes: npt.NDArray[np.uint16]
    rest: Bytes
    book: Array
    low: Array
    grain: Array
    faint: float
    held: Splats


def packed_splats(splats: Splats, least: Array, most: Array, floor: float) -> Packed:
    """Gaussians of linear light, one or more, as the page has them.

    Args:
        splats: Of linear light.
        least: Least spacing [N] that each was trained at, scene units.
        most: Most spacing [N] that each was trained at, scene units.
        floor: The dimmest colour that matters, in the unit of the colours.

    Returns:
        Codes, and the Gaussians as these hold them.
    """
    unit = splats.world.unit
    origin = np.asarray(splats.world.origin) - splats.offset
    away = (splats.means - origin) / unit
    quats = splats.quats * np.where(splats.quats[:, :1] < 0, -1.0, 1.0)
    constants = 0.5 + C0 * splats.harmonics[:, 0]
    with np.errstate(divide="ignore"):
        spacings = np.log(np.column_stack([least, most])).clip(-_FAR, _FAR)
    values = np.column_stack(
        [
            *(np.sign(away) * np.log1p(np.abs(away))).T,
            splats.logits.clip(-_SOLID, _SOLID),
            *np.log(splats.scales / unit).T,
            spacings[:, 0],
            *quats[:, 1:].T,
            spacings[:, 1],
            *np.arcsinh(constants / floor).T,
            np.zeros(len(splats)),
        ]
    )
    low = values.min(axis=0)
    span = np.ptp(values, axis=0)
    grain = np.where(span > 0, span, 1.0) / 65535
    exact = (values - low) / grain
    codes = np.round(exact).astype(np.uint16)
    places = np.round(exact[:, :3] * _FINE).astype(np.int64)
    codes[:, :3] = places // _FINE
    codes[:, 15] = (places % _FINE) @ [1024, 32, 1]
    decoded = low + grain * codes
    bent = low[:3] + grain[:3] * places / _FINE
    parts = decoded[:, 8:11]
    whole = np.sqrt(np.maximum(0, 1 - np.square(parts).sum(axis=1)))
    light = floor * np.sinh(decoded[:, 12:15])
    harmonics, rest, book = _harmonics(splats, light, floor)
    held = replace(
        splats,
        means=origin + unit * np.sign(bent) * np.expm1(np.abs(bent)),
        scales=np.exp(decoded[:, 4:7]) * unit,
        quats=np.column_stack([whole, parts]),
        opacities=1 / (1 + np.exp(-decoded[:, 3])),
        harmonics=harmonics,
    )
    return Packed(codes, rest, book, low, grain, floor, held)


def _harmonics(splats: Splats, light: Array, floor: float) -> tuple[Array, Bytes, Array]:
    """Harmonics as held, the bytes of those above the constant one, and the values that these name."""
    constant = ((light - 0.5) / C0)[:, None]
    if not splats.degree:
        return constant, np.zeros((0, COEFFICIENTS - 1, 3), np.uint8), np.zeros(256)
    bent = np.zeros((len(splats), COEFFICIENTS - 1, 3))
    degree_terms = min(splats.harmonics.shape[1], COEFFICIENTS) - 1
    bent[:, :degree_terms] = np.arcsinh(splats.harmonics[:, 1 : degree_terms + 1] / floor)
    steps = codebook(bent[:, :degree_terms])
    book = (floor * np.sinh(steps)).astype(np.float32).astype(np.float64)
    codes = nearest(bent, steps)
    return np.concatenate([constant, book[codes[:, :degree_terms]]], axis=1), codes, book


def _page(job: Job, packed: Packed) -> str:
    scene = job.scene
    facts, sky = _facts(job, packed), b""
    far = far_light_of(scene)
    if far is not None:
        light = far.ln_light.exp().movedim(0, 2).numpy()
        shown = in_colour((light * job.factor).astype("<f4"), scene.record.bands)
        facts["sky"] = {"rows": len(shown), "axes": far.axes.ravel().tolist()}
        sky = shown.tobytes()
    about = (
        f"{len(packed.held):,} Gaussians of {what_is_shown(scene.record.bands)}, {scene.record.radiance}, "
        f"times {job.factor:.6g}. Nothing is clipped before the exposure."
    )
    folder = files("recon.exports.formats") / "viewer"
    parts = {name: (folder / name).read_text("utf-8") for name in _PARTS}
    parts |= {
        "title": escape(scene.folder.resolve().name),
        "about": escape(about),
        "facts": json.dumps(facts, allow_nan=False).replace("<", "\\u003c"),
        "codes": _text(_planes(packed.codes.astype("<u2"))),
        "rest": _text(_planes(packed.rest)),
        "sky": _text(sky),
    }
    page = (folder / "page.html").read_text("utf-8")
    return re.sub(r"\[\[([\w.]+)\]\]", lambda place: parts[place[1]], page)


def _facts(job: Job, packed: Packed) -> dict[str, Any]:
    """Return what the page knows of the scene beside its Gaussians; places are in scene coordinates."""
    scene, record, limits = job.scene, job.scene.record, job.scene.renderer.limits
    cut = 0.0
    if limits.luminance_reference is not None:
        cut = limits.tau * limits.luminance_reference * job.factor
        cut *= record.normaliser if record.display is None else 1.0
    return {
        "count": len(packed.held),
        "degree": min(packed.held.degree, DEGREE),
        "low": packed.low.tolist(),
        "grain": packed.grain.tolist(),
        "faint": packed.faint,
        "book": packed.book.tolist(),
        "nearest": limits.near,
        "blur": limits.blur,
        "dimmest": limits.alpha_min,
        "cut": cut,
        "margin": limits.tangent_margin,
        "factor": job.factor,
        "luminance": scene.luminance_scale,
        "up": scene.up.tolist(),
        "home": 0,
        "begins": _begins(job)._asdict(),
        "views": [_view(scene, view) for view in scene.views],
    }


def _begins(job: Job) -> Beginning:
    """Return the look that the page begins with: that of `rig view`, unless the exposure was chosen."""
    record = job.scene.record
    if record.display is not None:
        return Beginning(0.0, "linear")
    shots = [[(shot.file, shot.k) for shot in view.shots] for view in record.views]
    look = beginning(record.exposure, shot_at(shots))
    return look if job.stops is None else look._replace(stops=0.0)


def _view(scene: Scene, view: SceneView) -> dict[str, Any]:
    """Return where a view stands, and its lens without distortion; px of the upright picture."""
    motion = as_held(scene.record.world.camera(view.splat_camera).cam_from_world, view.orientation)
    turn, shift = motion[:3, :3], motion[:3, 3]
    lens = view.lens.as_held(view.orientation)
    return {
        "name": view.name,
        "turn": turn.ravel().tolist(),
        "centre": (-turn.T @ shift).tolist(),
        **{name: getattr(lens, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
    }


def _planes(values: AnyArray) -> bytes:
    """The bytes of [N, ...] plane by plane: those of one plane are alike, which compresses better."""
    return values.reshape(len(values), math.prod(values.shape[1:])).view(np.uint8).T.tobytes()


def _text(data: bytes) -> str:
    """Packed, in letters that HTML holds."""
    return base64.b64encode(zlib.compress(data, 9)).decode()
