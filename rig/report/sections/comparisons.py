"""The section of pictures: held-out views at several exposures, beside the truth or the photograph."""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Bytes, Floats
from imaging.colour.spaces import balanced, srgb_encode
from imaging.demosaicking.demosaic import demosaic
from imaging.merge.linear_frame import decode
from imaging.optics.pose import upright
from imaging.progress import Progress
from imaging.session.view_id import ViewId
from recon.data.dataset import View
from recon.data.shot import Shot
from recon.measure.truth import has_truth, true_radiance
from recon.result.display import in_colour
from recon.result.opened import Opened
from rig.report.charts.pictures import (
    MAP_STOPS,
    colour_bar,
    developed,
    error_map,
    fitted,
    jpeg_uri,
    png_uri,
    three_exposures,
)
from rig.report.sections.shots import compressed

MOST_VIEWS = 6
WIDTH = 480
"""Pixels that a picture is at most wide in the page."""


@dataclass(frozen=True)
class ComparedPicture:
    """One picture, and what it shows."""

    uri: str
    caption: str
    alt: str


@dataclass(frozen=True)
class Comparison:
    """One view: columns of pictures, what is compared above each other."""

    title: str
    columns: tuple[tuple[ComparedPicture, ...], ...]


@dataclass(frozen=True)
class PicturesSection:
    """Everything the section shows."""

    lead: str
    views: tuple[Comparison, ...]
    bar: str
    bar_stops: str
    reference: str


def pictures(
    opened: Opened,
    scale: float,
    names: Mapping[ViewId, str],
    progress: Progress,
    until: float = math.inf,
) -> PicturesSection | None:
    """Draw held-out views; training views if there are no held-out ones, which the section says.

    Args:
        opened: Scene, with its photographs.
        scale: The one factor that the evaluation aligned all renders with.
        names: Names of the photographs of an import (`Session.photograph_names`).
        progress: Callback for the current step, the steps done, and all of them.
        until: Reading of `time.monotonic` after which no view is begun but the first.

    Returns:
        The section; None without any view.
    """
    held_out = opened.dataset.reported
    there = held_out or opened.dataset.train
    views = there[:MOST_VIEWS]
    if not views:
        return None
    with_truth = has_truth(opened.dataset.session)
    kind = "Held-out views, which the training never saw" if held_out else "Training views: none was held out"
    against = "the simulator's true light" if with_truth else "the photographs themselves"
    session, bands = opened.dataset.session, opened.record.bands
    truths = [in_colour(true_radiance(session, view, bands), bands) for view in views] if with_truth else []
    stops = three_exposures(np.stack(truths)) if with_truth else (0.0, 0.0, 0.0)
    compared = []
    for done, view in enumerate(views):
        if done and time.monotonic() >= until:
            break
        progress("drawing held-out views", done, len(views))
        if with_truth:
            light = in_colour(opened.radiance(view), bands) * np.float32(scale)
            columns = _against_truth(truths[done], light, stops, view.orientation)
        else:
            columns = _against_shots(opened, view)
        title = f"Camera {view.camera}, frame {view.frame}"
        if view.id in names:
            title += f" ({names[view.id]})"
        compared.append(Comparison(title, tuple(columns)))
    shown = f" {len(compared)} of {len(there)} are shown." if len(compared) < len(there) else ""
    return PicturesSection(
        lead=f"{kind}, beside {against}. Both are developed alike.{shown}",
        views=tuple(compared),
        bar=colour_bar(),
        bar_stops=f"{MAP_STOPS:g}",
        reference="truth" if with_truth else "photograph",
    )


def _against_truth(
    truth: Floats, render: Floats, stops: Sequence[float], orientation: int
) -> Iterable[tuple[ComparedPicture, ...]]:
    middle = stops[1]
    for step in stops:
        name = _relative(step - middle)
        yield (
            _photo(developed(truth, step), f"Truth, {name}", orientation),
            _photo(developed(render, step), f"Render, {name}", orientation),
        )
    yield (
        _photo(compressed(truth), "Truth, compressed", orientation),
        _map(error_map(render, truth), "Error of the render", orientation),
    )


def _against_shots(opened: Opened, view: View) -> Iterable[tuple[ComparedPicture, ...]]:
    """The photographs of a view beside what the model says they should be: at most three of a bracket."""
    image = opened.render(view.lens)
    count = len(view.shots)
    middle = view.shots[count // 2]
    errors = []
    for shot in [view.shots[index] for index in sorted({0, count // 2, count - 1})]:
        predicted = (
            opened.training.method.observation.predict(image, view, shot.k, shot.band).detach().numpy()
        )
        name = "" if count == 1 else f", {_relative(float(np.log2(shot.k / middle.k)))}"
        photograph = _photo(_as_shown(shot.pixels, view), f"Photograph{name}", view.orientation)
        render = _photo(_as_shown(predicted, view), f"Render{name}", view.orientation)
        errors.append(_map(_shot_error(shot, predicted, view), f"Error{name}", view.orientation))
        yield from [(photograph,), (render,)] if count == 1 else [(photograph, render)]
    # The shortest exposure shows little but the highlights.
    yield tuple(errors[-2:])


def _as_shown(pixels: Floats, view: View) -> Bytes:
    """Code values as they are; linear signals demosaicked, white-balanced and developed."""
    if view.sensor.kind == "ldr":
        return np.asarray(np.rint(255 * np.clip(pixels, 0, 1)), np.uint8)
    return np.asarray(np.rint(255 * srgb_encode(np.clip(_balanced(pixels, view), 0, 1))), np.uint8)


def _balanced(pixels: Floats, view: View) -> Floats:
    """A linear signal as rgb [H, W, 3] in which a neutral surface is grey."""
    rgb = pixels if view.sensor.cfa is None else demosaic(pixels, view.sensor.cfa).rgb
    return balanced(rgb, view.sensor.camera_from_rec709.sum(1).tolist())


def _shot_error(shot: Shot, predicted: Floats, view: View) -> Bytes:
    """Error of light where the photograph is neither clipped, nor dark, nor invalid."""
    said = ~shot.saturated & ~shot.dark & shot.valid
    valid = said[..., None] if said.ndim == 2 else np.all(said, axis=-1, keepdims=True)
    if view.sensor.kind == "ldr":
        true = decode(np.ascontiguousarray(shot.pixels, np.float32), view.sensor.response)
        mine = decode(np.clip(predicted, 0, 1).astype(np.float32), view.sensor.response)
        return error_map(mine, np.where(valid, true, np.nan))
    true, mine = _balanced(shot.pixels, view), _balanced(predicted, view)
    return error_map(mine, np.where(valid, true, np.nan))


def _relative(stops: float) -> str:
    return (
        "middle exposure"
        if abs(stops) < 0.05
        else f"{stops:+.1f} stops".replace("-", "−").replace(".0 ", " ")
    )


def _photo(pixels: Bytes, caption: str, orientation: int) -> ComparedPicture:
    return ComparedPicture(jpeg_uri(fitted(upright(pixels, orientation), WIDTH)), caption, caption)


def _map(pixels: Bytes, caption: str, orientation: int) -> ComparedPicture:
    uri = png_uri(fitted(upright(pixels, orientation), WIDTH))
    return ComparedPicture(uri, caption, f"{caption}, as a map of colours")
