"""Light in the photographs of a view, sample by sample, beside that of a render."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from imaging import metrics
from imaging.arrays import Array32, Mask
from imaging.merge.bracket import merge_bracket
from imaging.merge.linear_frame import DARK_CODE, decode
from recon.data.dataset import View
from recon.data.shot import ABOVE
from recon.observe.glare import scattered
from recon.observe.linear import Observation

MOST_SAMPLES = 200_000
"""Most samples of a view; of more as many are drawn, always the same."""


@dataclass(frozen=True)
class RecordedLight:
    """Light at samples [N], photosites or channels of pixels, behind lens and filters, in calibrated units.

    rendered, recorded: float32. at_least, at_most: where what was recorded is only a bound of the light,
    since every shot clips there, or since it is below `ABOVE` standard deviations of the noise.
    """

    rendered: Array32
    recorded: Array32
    at_least: Mask
    at_most: Mask


def recorded_light(observation: Observation, image: torch.Tensor, view: View) -> RecordedLight:
    """Return the light in a view's photographs, merged, beside a render [H, W, 3] of it."""
    sensor = view.sensor
    response = sensor.response if sensor.kind == "ldr" else None
    merged = merge_bracket([shot.linear(response, sensor.cfa) for shot in view.shots])
    recorded, at_most = merged.radiance, merged.dark
    if merged.sigma is not None:
        least = ABOVE * merged.sigma
        noisy = merged.valid & (recorded < least)
        recorded, at_most = np.where(noisy, least, recorded), at_most | noisy
    if response is not None:
        # The lowest codes say that the light is below the next, not that it is 0.
        darkest = decode(np.full((1, 3), DARK_CODE), response)[0] / max(shot.k for shot in view.shots)
        recorded = np.where(merged.dark, np.maximum(recorded, darkest), recorded)
    known = np.flatnonzero(~np.isnan(recorded))
    if len(known) > MOST_SAMPLES:
        known = np.sort(np.random.default_rng(0).choice(known, MOST_SAMPLES, replace=False))
    rendered, light = (plane.reshape(-1)[known] for plane in (_rendered(observation, image, view), recorded))
    at_least, at_most = (plane.reshape(-1)[known] for plane in (merged.clipped, at_most))
    return RecordedLight(rendered, np.asarray(light, np.float32), at_least, at_most)


def against_photographs(views: Sequence[RecordedLight]) -> dict[str, Any]:
    """Median errors in stops by how bright the recorded light is, of the samples of all views together.

    stops_median of all, stops_dark, _middle, _bright and _brightest of `metrics.LIGHT`; stops_bound: the
    share of the brightest hundredth that is but a lower bound, 0..1.
    """
    rendered, recorded, at_least, at_most = (
        np.concatenate([getattr(view, name) for view in views])
        for name in ("rendered", "recorded", "at_least", "at_most")
    )
    if not len(recorded):
        return {}
    bright = recorded >= np.quantile(recorded, metrics.LIGHT["bright"][0])
    return {
        "stops_median": metrics.stops_median(rendered, recorded, at_least=at_least, at_most=at_most),
        **{
            f"stops_{name}": metrics.stops_median(
                rendered, recorded, among, at_least=at_least, at_most=at_most
            )
            for name, among in metrics.LIGHT.items()
        },
        "stops_against": "photographs",
        "stops_bound": float(at_least[bright].mean()),
    }


def _rendered(observation: Observation, image: torch.Tensor, view: View) -> Array32:
    """The light of a render as it arrives at the samples of a view's photographs."""
    sensor = view.sensor
    if sensor.kind != "ldr":
        return np.asarray(observation.predict(image, view, 1.0).numpy(), np.float32)
    light = scattered(observation.radiance(image), sensor.glare).numpy()
    developed = sensor.falloff[..., None] * np.array(sensor.white_balance, np.float32)
    return np.asarray(light * developed, np.float32)
