"""Plan of focus and views: where to focus, at which f-number, and how far apart to shoot.

Thin lens, monochromatic light. Blur is the standard deviation along one axis of the image of a point, so that
defocus (an evenly lit disc: a quarter of its diameter) and diffraction (the Gaussian closest to an Airy disc)
add in squares. (Hecht, "Optics", 5th edition, chapters 5 and 10; the Gaussian: Zhang, Zerubia and
Olivo-Marin, "Gaussian approximations of fluorescence microscope point-spread function models", Applied Optics
46, 2007.)
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, ceil, degrees, hypot, inf, radians, sin

WAVELENGTH = 0.55e-6
"""m, green."""
AIRY = 0.42
"""Standard deviation of the Gaussian closest to an Airy disc, in wavelengths times the f-number."""
SHARP = 0.5
"""Blur, pixels, up to which a picture counts as sharp: an edge then takes about one pixel."""
OVERLAP = 2 / 3
"""Share of a picture that its neighbour should show, too."""
TURN = 30.0
"""Largest angle between the directions of neighbours, degrees."""
F_NUMBERS = tuple(round(2 ** (third / 6), 1) for third in range(31))
"""Thirds of a stop from 1 to 32, for lenses that state none of their own."""


@dataclass(frozen=True)
class FocusPlan:
    """Focus of a camera, its sharpness, and the spacing of its views.

    focus: distance to focus at, m. blur: of the nearest and of the farthest at `f_number`, pixels; None where
    no f-number is planned. sharp_width: of pictures in which that is sharp, px. advised, advised_blur,
    advised_width: the lowest f-number at which both are sharp at full size, or the one at which they are
    sharpest. sees: width of what a picture shows at the nearest, m. step: largest distance between
    neighbouring positions, m. around: positions all the way round the subject; None where it has no end.
    """

    focus: float
    f_number: float | None
    blur: float | None
    sharp_width: int | None
    advised: float
    advised_blur: float
    advised_width: int
    sees: float
    step: float
    around: int | None


def focus_plan(
    lens: tuple[float, float],
    width: int,
    subject: tuple[float, float],
    f_number: float | None,
    f_numbers: Sequence[float] = (),
) -> FocusPlan | None:
    """Plan focus and views of one camera.

    Args:
        lens: Focal length, mm, and distance between photosites, um.
        width: Photosites across a picture.
        subject: Distances of the nearest and the farthest that is to be sharp, m; the latter may be infinite.
        f_number: Of all exposures; None where none is planned.
        f_numbers: Those that the lens has; empty: third stops from 1 to 32.

    Returns:
        The plan; None where the lens cannot focus at the subject, since its focal length is longer.
    """
    focal, pitch, (near, far) = lens[0] * 1e-3, lens[1] * 1e-6, subject
    # A disc is focal / f_number * image * |1 / focus - 1 / distance| wide: those of both ends are equal here.
    focus, apart = 2 / (1 / near + 1 / far), 0.5 * (1 / near - 1 / far)
    if near <= focal:
        return None
    image = 1 / (1 / focal - 1 / focus)

    def blur(number: float) -> float:
        defocus = 0.25 * focal / number * image * apart
        diffraction = AIRY * WAVELENGTH * number * image / focal
        return hypot(defocus, diffraction) / pitch

    def sharp_width(blurred: float) -> int:
        return int(width * min(1.0, SHARP / blurred))

    choices = sorted(f_numbers or F_NUMBERS)
    sharp = [number for number in choices if blur(number) <= SHARP]
    advised = sharp[0] if sharp else min(choices, key=blur)
    sees = width * pitch * near / image
    step, middle = (1 - OVERLAP) * sees, 0.5 * (near + far)
    around = None
    if far < inf:
        step = min(step, 2 * middle * sin(radians(0.5 * TURN)))
        around = ceil(360 / degrees(2 * asin(0.5 * step / middle)) - 1e-9)
    return FocusPlan(
        focus=focus,
        f_number=f_number,
        blur=None if f_number is None else blur(f_number),
        sharp_width=None if f_number is None else sharp_width(blur(f_number)),
        advised=advised,
        advised_blur=blur(advised),
        advised_width=sharp_width(blur(advised)),
        sees=sees,
        step=step,
        around=around,
    )
