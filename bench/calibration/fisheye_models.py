"""Loss of a lens of another model by the fisheyes that `rig calibrate` fits.

    python -m bench.calibration.fisheye_models [--json] [--write]

The unified camera model with both parameters free (EUCM: Khomutenko, Garcia and Martinet, "An Enhanced
Unified Camera Model", 2016) bends rays by two numbers beside a focal length. Lenses of alpha 0.5 to 0.7 and
beta 0.9 to 1.4 fill a circle of 1,000 px. The two fisheyes are fitted to them by least squares of the pixels,
and the largest error in pixels is reported.
"""

import math
from typing import Any

import numpy as np

from bench.support.record import arguments, deliver
from imaging.arrays import Array
from imaging.optics.lens import WIDEST, Lens, LensModel, project

ALPHAS = (0.5, 0.55, 0.6, 0.65, 0.7)
BETAS = (0.9, 1.0, 1.1, 1.2, 1.4)
REACHES = (50, 60, 70, 80, 88)
"""Degrees from the axis."""
RADIUS = 1000.0
"""px."""
FITTED: dict[LensModel, tuple[int, ...]] = {"RADIAL_FISHEYE": (3, 5), "OPENCV_FISHEYE": (3, 5, 7, 9)}
"""Powers of the angle beside the first."""
ANGLES = 400


def unified(angles: Array, alpha: float, beta: float) -> Array:
    """Focal lengths from the principal point at which EUCM puts rays at these angles from the axis."""
    sine, cosine = np.sin(angles), np.cos(angles)
    return np.asarray(sine / (alpha * np.sqrt(beta * sine**2 + cosine**2) + (1 - alpha) * cosine))


def nearest(model: LensModel, angles: Array, radii: Array) -> Lens:
    """The fisheye that is nearest to places [N] of rays at angles [N], px from the principal point."""
    powers = FITTED[model]
    focal, *terms = np.linalg.lstsq(angles[:, None] ** np.array((1, *powers)), radii, rcond=None)[0].tolist()
    named = {f"k{number}": term / focal for number, term in enumerate(terms, 1)}
    return Lens(model=model, width=2000, height=2000, fx=focal, fy=focal, cx=1000, cy=1000, **named)


def farthest(model: LensModel, alpha: float, beta: float, reach: float) -> float:
    """Pixels by which a fitted fisheye puts a ray elsewhere, at worst."""
    angles = np.linspace(0, min(math.radians(reach), WIDEST), ANGLES)
    radii = unified(angles, alpha, beta)
    radii *= RADIUS / radii[-1]
    points = np.stack([np.sin(angles), np.zeros(ANGLES), np.cos(angles)], axis=1)
    projected = project(nearest(model, angles, radii), points)[:, 0] - RADIUS
    return float(np.abs(projected - radii).max())


def measure() -> dict[str, Any]:
    every = [(alpha, beta) for alpha in ALPHAS for beta in BETAS]
    return {
        model: {reach: [farthest(model, *one, reach) for one in every] for reach in REACHES}
        for model in FITTED
    }


def table(result: dict[str, Any]) -> str:
    lines = [
        "# Lenses of the unified camera model by the fisheyes of rig",
        "",
        "`python -m bench.calibration.fisheye_models --write`. The pixel that is farthest off, of a circle "
        f"of {RADIUS:,.0f} px: median and worst of {len(ALPHAS) * len(BETAS)} lenses.",
        "",
        f"| degrees from the axis | {' | '.join(f'{model}, px' for model in FITTED)} |",
        "|---|" + "---|" * len(FITTED),
    ]
    for reach in REACHES:
        cells = [
            f"{np.median(result[model][reach]):.4f} ({max(result[model][reach]):.4f})" for model in FITTED
        ]
        lines.append(f"| {reach} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    result = measure()
    deliver(options, "fisheye_models", result, table(result))


if __name__ == "__main__":
    main()
