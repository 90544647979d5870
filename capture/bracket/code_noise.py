"""Noise model of a camera that develops its own photographs, from their codes.

Its tone curve is not known before it is calibrated. But between two probes light differs by a known
ratio at every pixel, and how far the code moves there is the slope of the curve; what is assumed is only
that the curve is smooth, with sRGB's shape between its nodes, and how far codes can be trusted.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from imaging.arrays import Array, Floats
from imaging.colour.spaces import srgb_decode
from imaging.merge.linear_frame import CODE_NOISE
from imaging.optics.exposure import Exposure

DARKEST, BRIGHTEST = 10 / 255, 245 / 255
"""Codes between which a photograph is trusted: below are compression and a black point, above a shoulder."""
NODES, SMOOTH = 9, 0.03
"""Points of the estimated curve, and the weight of its smoothness against one pair of codes of the mean."""
ASSUMED = (
    "the codes 10 to 245 are taken as usable, with a noise of one code, on a tone curve seen in the probes"
)


@dataclass(frozen=True, eq=False)
class CodeNoise:
    """Quality of an exposure. codes: ascending from DARKEST to BRIGHTEST, float64 [n].

    light: natural logarithm of the light that gives a code, 0 at the last; ratios: signal to noise there.
    A higher ISO counts as light alone, since its noise is not known.
    """

    codes: Array
    light: Array
    ratios: Array

    @classmethod
    def of(cls, lower: Array, upper: Array, stops: Array) -> Self:
        """Fit the model to codes [n] of the same pixels in two exposures at a known distance in stops.

        Least squares on NODES spread evenly over the logarithm of light as sRGB has it; a curve that
        bends as little as the codes allow.
        """
        codes = np.arange(round(255 * DARKEST), round(255 * BRIGHTEST) + 1) / 255
        scale = np.log(srgb_decode(codes)).astype(np.float64)
        nodes = np.linspace(scale[0], scale[-1], NODES)
        tight = (lower >= DARKEST) & (upper <= BRIGHTEST) & (upper > lower)
        rows = _hat(upper[tight], nodes) - _hat(lower[tight], nodes)
        wanted = stops[tight] * math.log(2)
        weight = 1 / math.sqrt(max(len(wanted), 1))
        bend = SMOOTH * np.diff(np.eye(NODES), 2, axis=0)
        # Where no pair reaches, the curve goes on as straight as it was, and as sRGB without any.
        level = 1e-3 * np.diff(np.eye(NODES), axis=0)
        system = np.concatenate([weight * rows, bend, level, np.eye(NODES)[-1:]])
        target = np.concatenate([weight * wanted, np.zeros(NODES - 2), 1e-3 * np.diff(nodes), [0.0]])
        solved = np.linalg.lstsq(system, target, rcond=None)[0]
        light = np.maximum.accumulate(np.interp(scale, nodes, solved)) + 1e-6 * np.arange(len(codes))
        light -= light[-1]
        return cls(codes, light, 1.0 / (CODE_NOISE * np.gradient(light, codes)))

    @property
    def stops(self) -> float:
        """Stops between the darkest and the brightest code."""
        return float(-self.light[0] / math.log(2))

    def light_of(self, codes: Floats) -> Array:
        """Light of codes, 1 at BRIGHTEST; those beyond the trusted ones as their ends."""
        return np.asarray(np.exp(np.interp(codes, self.codes, self.light)))

    def snrs(self, radiances: Array, exposure: Exposure) -> Array:
        """Signal to noise in dB, 20 log10; below the darkest code it falls with the light."""
        light = np.log(np.maximum(radiances * exposure.scale, 1e-300))
        below = np.minimum(light - self.light[0], 0.0)
        return np.asarray(20.0 * (np.log10(np.interp(light, self.light, self.ratios)) + below / math.log(10)))

    def snr(self, radiance: float, exposure: Exposure) -> float:
        """The same of one radiance; -inf without light."""
        return float(self.snrs(np.array([radiance]), exposure)[0]) if radiance > 0 else -math.inf

    def darkest(self, snr: float, exposure: Exposure) -> float:
        """The radiance from which on a code is trusted and has `snr` dB; infinite if none has."""
        enough = np.flatnonzero(self.ratios >= math.pow(10.0, snr / 20.0) * (1 - 1e-12))
        return math.exp(self.light[enough[0]]) / exposure.scale if len(enough) else math.inf

    def brightest(self, exposure: Exposure) -> float:
        """The radiance of the brightest code."""
        return 1.0 / exposure.scale


def _hat(codes: Array, nodes: Array) -> Array:
    """Weights [n, NODES] that interpolate between nodes at the logarithm of the light of `codes` [n]."""
    scale = np.log(srgb_decode(np.clip(codes, DARKEST, BRIGHTEST))).astype(np.float64)
    place = np.clip((scale - nodes[0]) / (nodes[1] - nodes[0]), 0, len(nodes) - 1 - 1e-9)
    index = place.astype(np.intp)
    weights = np.zeros((len(codes), len(nodes)))
    weights[np.arange(len(codes)), index] = 1 - (place - index)
    weights[np.arange(len(codes)), index + 1] = place - index
    return weights
