"""Random scenes before cameras with real sensors, and the definition of a bracket that shows them.

Nothing here uses the planner's own arithmetic: SNR and clipping follow from electrons, as EMVA 1288 has them.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import numpy.typing as npt

from capture.bracket.code_noise import CodeNoise
from capture.bracket.planner import SLACK, Target
from capture.bracket.raw_noise import RawNoise
from drivers.sim.camera.sensor import SensorModel
from imaging.arrays import Array, Mask
from imaging.merge.bracket import MARGIN
from imaging.optics.exposure import Exposure
from imaging.sensor.noise import SensorNoise

MOST = 24
"""Exposures of a list, all shutter times at all ISOs together."""


def _sensor(well: float, read: float, bits: int, black: float) -> SensorModel:
    span = 2.0**bits - 1 - black
    return SensorModel(
        gain=span / well,
        read_noise=read,
        full_well=1.07 * well,
        black=((black,),),
        bit_depth=bits,
        prnu=0.005,
        dsnu=0.4,
        dark_current=0.5,
    )


SENSORS = {
    "IMX477, 12 bits": _sensor(8_180, 3.0, 12, 256),
    "IMX250, 12 bits": _sensor(10_700, 3.0, 12, 240),
    "full frame, 14 bits": _sensor(49_000, 2.0, 14, 512),
}
"""Electrons at white and of read noise as measured of such cameras; fixed patterns as simulated rigs have."""


def noise_of(sensor: SensorModel) -> RawNoise:
    """Return the planner's noise model from the file of a camera with that sensor."""
    noise = SensorNoise(gain=sensor.gain, read_noise=sensor.read_noise)
    return RawNoise(noise, sensor.white - sensor.black[0][0])


@dataclass(frozen=True)
class Case:
    """A scene before a rig of cameras of one make, their list, and the wanted SNR in dB."""

    targets: tuple[Target, ...]
    times: tuple[float, ...]
    isos: tuple[float, ...]
    snr: float

    @property
    def shots(self) -> list[Exposure]:
        """Every time at every ISO."""
        return [Exposure(time=t, f_number=4.0, iso=iso) for iso in self.isos for t in self.times]


def draw(sensor: SensorModel, rng: np.random.Generator) -> Case:
    """Lamps, walls and shadows of random brightness, one or two cameras, a random list."""
    isos = (100.0, 200.0, 400.0)[: int(rng.choice([1, 1, 1, 2, 3]))]
    step = float(rng.choice([1 / 3, 1 / 2, 2 / 3, 1.0, 1.0, 4 / 3, 2.0]))
    whole = rng.random() < 0.7
    count = MOST // len(isos) if whole else int(rng.integers(2, MOST // len(isos) + 1))
    last = float(rng.uniform(-5, 5))
    times = tuple(2.0 ** (last - step * n) for n in reversed(range(count)))
    middle = 4.0**2 * 0.1 / math.sqrt(times[0] * times[-1])
    targets = []
    for camera in range(int(rng.integers(1, 3))):
        light = middle * _light(rng)
        for channel, share in zip("RGB", (rng.uniform(0.4, 0.7), 1.0, rng.uniform(0.5, 0.8)), strict=True):
            dark, bright = np.percentile(share * light, [0.1, 99.99])
            targets.append(Target(f"cam{camera}", channel, noise_of(sensor), float(dark), float(bright)))
    return Case(tuple(targets), times, isos, float(rng.choice([10.0, 20.0, 20.0, 30.0])))


def _light(rng: np.random.Generator) -> Array:
    """Radiance of 20,000 photosites: one to four log-normal parts, up to 14 stops apart."""
    parts = int(rng.integers(1, 5))
    which = rng.choice(parts, 20_000, p=rng.dirichlet(np.ones(parts)))
    spread = rng.uniform(0.3, 2.0, parts)
    stops = rng.uniform(-7, 7, parts)[which] + spread[which] * rng.standard_normal(20_000)
    return np.asarray(2.0**stops)


def shown(noise: RawNoise | CodeNoise, exposure: Exposure, snr: float, radiance: Array) -> Mask:
    """Enough electrons, even if the exposure is SLACK shorter; no clipping, even if it is SLACK longer."""
    assert isinstance(noise, RawNoise)  # photographs count no electrons
    gain, read, scale = noise.sensor.gain * exposure.iso_gain, noise.sensor.read_noise, exposure.scale
    few = radiance / 2.0**SLACK * scale * noise.span / gain
    many = radiance * 2.0**SLACK * scale * noise.span / gain
    enough = 20 * np.log10(few / np.sqrt(few + read**2 + 1 / 12 / gain**2)) >= snr - 1e-9
    top = gain * (many + MARGIN * np.sqrt(many + read**2 + 1 / 12 / gain**2))
    return np.asarray(enough & (top <= noise.span * (1 + 1e-9)))


def demands(case: Case, shots: Sequence[Exposure]) -> npt.NDArray[np.uint32]:
    """Number for each radiance that some shot shows: a bit for every such shot.

    The radiances are representative: both ends of each target, and one between any two ends of intervals.
    """
    masks: set[int] = set()
    for target in case.targets:
        ends = [target.dark, target.bright]
        for shot in shots:
            ends.append(target.noise.darkest(case.snr, shot) * 2.0**SLACK)
            ends.append(target.noise.brightest(shot) / 2.0**SLACK)
        inside = np.unique([end for end in ends if target.dark <= end <= target.bright])
        wide = inside[1:] > inside[:-1] * (1 + 1e-6)
        points = np.concatenate([[target.dark, target.bright], np.sqrt(inside[1:] * inside[:-1])[wide]])
        bits = np.zeros(len(points), np.uint32)
        for number, shot in enumerate(shots):
            bits |= shown(target.noise, shot, case.snr, points).astype(np.uint32) << np.uint32(number)
        masks |= set(bits.tolist())
    return np.array(sorted(masks - {0}), np.uint32)


@cache
def subsets(of: int, size: int) -> npt.NDArray[np.uint32]:
    """All subsets of that size, a bit for each member."""
    chosen = np.fromiter(itertools.chain.from_iterable(itertools.combinations(range(of), size)), np.uint32)
    return np.asarray(np.left_shift(np.uint32(1), chosen.reshape(-1, size)).sum(axis=1), np.uint32)


def fewest(needed: npt.NDArray[np.uint32], of: int) -> int:
    """Brute force: the size of the smallest subset of `of` shots that meets all demands; at least one."""
    for size in range(1, of + 1):
        candidates = subsets(of, size)
        for demand in needed:
            candidates = candidates[(candidates & demand) != 0]
            if not len(candidates):
                break
        if len(candidates):
            return size
    raise AssertionError("all shots together meet every demand")


def unit(sensor: SensorModel, rng: np.random.Generator) -> SensorModel:
    """One sensor of a make, as far from its data sheet as those of the simulated rigs."""
    return replace(
        sensor,
        gain=sensor.gain * rng.uniform(0.985, 1.015),
        read_noise=sensor.read_noise * rng.uniform(0.93, 1.07),
    )
