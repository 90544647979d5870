"""All stages at the extremes, in one list."""

from collections.abc import Iterator

from imaging.progress import Progress, unreported
from imaging.stress_case import StressCase


def extremes(quick: bool, seed: int = 0, progress: Progress = unreported) -> Iterator[StressCase]:
    """Calibration, splatting, methods; quick: with smaller pictures."""
    from calib.stability import calibration
    from recon.stability import methods, splatting
    from recon.train.devices.warm_up import warm_up

    warm_up(progress)
    progress("calibration", 0, 0)
    yield from calibration(seed)
    yield from splatting(quick, seed, progress)
    yield from methods(seed, progress)
