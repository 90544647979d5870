"""A sensor at one ISO from repeated darks and flats: all that EMVA 1288 asks of them, with errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from calib.sensor.emva1288 import darks, defects, flats, pattern
from calib.sensor.emva1288.flats import FlatFalloff
from calib.sensor.linearity import straightness
from calib.sensor.photon_transfer import HIGHEST, SMALLEST, Points, Transfer, fit
from calib.sensor.stack import EVEN, Period, Stack, sites, tiles
from imaging.arrays import Array, Mask
from imaging.sensor.sensor_calibration import Measured, SensorCalibration

FILE_BLACK = 2.0
"""DN by which the black level of a file may be wrong."""


@dataclass(frozen=True, eq=False)
class Nominal:
    """Levels in the files: black of the CFA sites, float64 [sites], and white, DN; tile: its rows and
    columns.
    """

    black: Array
    white: float
    tile: Period = EVEN


@dataclass(frozen=True, eq=False)
class Frames:
    """Stacks of one ISO, of one size.

    few: of each stack of darks some frames, uint16 [H, W], needed where the sensor counts coarsely.
    """

    darks: Sequence[Stack] = ()
    flats: Sequence[Stack] = ()
    few: Sequence[Sequence[npt.NDArray[np.uint16]]] = ()


def measure_emva(
    frames: Frames, nominal: Nominal, iso: float | None, gain: Measured | None = None
) -> tuple[SensorCalibration, FlatFalloff | None]:
    """Measure the sensor from the frames.

    Args:
        frames: Stacks of darks and flats at one ISO, at least one.
        nominal: Levels that the files state.
        iso: ISO of the frames; None if the files state none.
        gain: Gain known from elsewhere, DN per electron, for darks without flats.

    Returns:
        The measured quantities; and the fall of light at the f-number of the flats, None if no flat shows it.
    """
    stacks = [*frames.darks, *frames.flats]
    shape = stacks[0].variance.shape
    none = np.zeros(shape, bool)
    hot, noisy, dead = none, none, none
    dark = max(frames.darks, key=lambda one: (one.time, one.frames), default=None)
    if dark is not None:
        hot, noisy = defects.in_the_dark(dark)
    usable = ~(hot | noisy)
    # Hot and noisy sites are left out of the levels that all others share.
    level = _level(frames, nominal, usable)
    plateau = flats.plateau(frames.flats, level.black, usable)
    top = (nominal.white if plateau is None else plateau.level) - float(level.black.mean())
    # Dead sites show in light alone, and only below the plateau where all sites are alike.
    lit = _brightest(frames.flats, level.black, HIGHEST * top)
    if lit is not None:
        dead = defects.in_light(lit, level.black) & ~hot
        usable = usable & ~dead
        level = _level(frames, nominal, usable)
    points = _points(frames, level.black, usable, HIGHEST * top)
    usable_points = points.part((points.freedom > 0) & (points.variance > 0))
    white = nominal.white - float(level.black.mean())
    # The sensor is straightened before its gain is fitted: a bend looks like another gain at each level.
    shared = flats.shared_levels(frames.flats, level.black, usable, white, 0.95 * top)
    line = straightness(shared, float(level.black_error.mean()) / white)
    if line is not None and not line.linear:
        points = points.straightened(line.share / white)
    # Darks give a gain too, by the noise of their dark current, but roughly.
    known = gain if not frames.flats else None
    transfer = fit(points) if known is None else _in_the_dark(points, known)
    values: dict[str, object] = {
        "iso": iso,
        "transfer": tuple(zip(usable_points.light.tolist(), usable_points.variance.tolist(), strict=True)),
    }
    source = "darks and flats" if frames.darks and frames.flats else "darks" if frames.darks else "flats"

    def put(name: str, value: float, sigma: float, of: str = source) -> None:
        values[name] = Measured.model_validate({"value": value, "sigma": sigma, "source": of})

    if frames.darks:
        values["black"] = black_record(level.black, level.black_error, nominal.tile, "darks")
    if plateau is not None:
        put("ceiling", plateau.level, plateau.scatter, "flats")
    if transfer is not None:
        _electrons(frames, transfer, level, top, plateau is not None, usable, put)
    if lit is not None:
        shortest = min(frames.darks, key=lambda one: one.time, default=None)
        prnu = pattern.photo_response(lit, shortest, level.black, usable)
        if prnu is not None:
            put("prnu", *prnu, "flats")
    if dark is not None or lit is not None:
        values["defects"] = defects.listed(hot, noisy, dead)
    if line is not None:
        put("nonlinearity", line.share, line.error, "flats")
        values["linear"] = line.linear
    fall = None if lit is None else flats.falloff(lit, level.black, usable)
    return SensorCalibration.model_validate(values), fall


def black_record(
    black: Array, error: Array, tile: Period, source: Literal["darks", "brackets"]
) -> tuple[tuple[Measured, ...], ...]:
    """Black of the CFA sites [sites] as a sensor's record has it, row by row."""
    levels = [
        Measured(value=float(value), sigma=float(sigma), source=source)
        for value, sigma in zip(black, error, strict=True)
    ]
    return tuple(tuple(levels[start : start + tile[1]]) for start in range(0, len(levels), tile[1]))


def _level(frames: Frames, nominal: Nominal, usable: Mask) -> darks.Dark:
    """Black by the darks; by the files without them, and by likelihood where the sensor counts coarsely."""
    if not frames.darks:
        return darks.Dark(nominal.black, np.full(len(nominal.black), FILE_BLACK), None)
    means = [darks.mean(stack, usable) for stack in frames.darks]
    if is_coarse(frames.darks):
        for index, few in enumerate(frames.few):
            for site, one in enumerate(_coarse(few, usable, nominal.tile)):
                if one is not None:
                    means[index].value[site], means[index].error[site] = one.black, one.black_error
    return darks.level([stack.time for stack in frames.darks], means)


def is_coarse(stacks: Sequence[Stack]) -> bool:
    """Return whether darks scatter too little, or too close to 0, for their numbers to be taken as they
    are.
    """
    shortest = min(stacks, key=lambda one: one.time)
    spread = np.median(sites(shortest.variance, shortest.tile), axis=(1, 2))
    return bool(np.any(spread < SMALLEST) or shortest.levels.min() < 4.0 * np.sqrt(spread.max()))


def _coarse(few: Sequence[npt.NDArray[np.uint16]], usable: Mask, tile: Period) -> list[darks.Coarse | None]:
    mask, planes = sites(usable, tile), [sites(frame, tile) for frame in few]
    return [darks.coarse([plane[site][mask[site]] for plane in planes]) for site in range(len(mask))]


def _brightest(stacks: Sequence[Stack], black: Array, top: float) -> Stack | None:
    """The brightest flat whose photosites all keep clear of the ceiling; top: DN above black."""
    light = {
        i: float(np.percentile(sites(s.mean, s.tile), 99)) - float(black.mean()) for i, s in enumerate(stacks)
    }
    clear = [i for i in light if 0.05 * top < light[i] < top]
    return stacks[max(clear, key=lambda i: light[i])] if clear else None


def _points(frames: Frames, black: Array, usable: Mask, top: float) -> Points:
    """One point for each stack and CFA site, over the tiles that are not too bright.

    The noise of a tile's mean and of its variance are correlated, which would pull the line: average first.
    """
    parts: list[Points] = []
    # Numbers of coarse darks do not scatter as the signal does.
    dark = () if frames.darks and is_coarse(frames.darks) else frames.darks
    for stack in [*dark, *frames.flats]:
        if stack.frames >= 2:
            cut = tiles(stack, usable)
            light = cut.mean - black[cut.site]
            count = np.bincount(cut.site[light < top], cut.count[light < top], len(black))
            weight = np.where(light < top, cut.count, 0.0) / np.maximum(count, 1.0)[cut.site]
            mean, variance = (
                np.bincount(cut.site, weight * values, len(black)).astype(np.float64)
                for values in (light, cut.variance)
            )
            parts.append(Points(mean, variance, ((stack.frames - 1) * count).astype(np.float64)))
    empty = np.zeros(0)
    return Points.joined(parts) if parts else Points(empty, empty, empty)


def _in_the_dark(points: Points, gain: Measured) -> Transfer | None:
    """Read noise from darks alone, which a gain from elsewhere turns into electrons."""
    if not len(points.light):
        return None
    weight = points.freedom / points.variance.mean() ** 2 / 2.0
    floor = float((weight * (points.variance - gain.value * points.light)).sum() / weight.sum())
    return Transfer(gain.value, floor, np.diag([gain.sigma**2, 1.0 / float(weight.sum())]))


def _electrons(
    frames: Frames, transfer: Transfer, level: darks.Dark, top: float, ends: bool, usable: Mask, put: object
) -> None:
    """Quantities in electrons."""
    assert callable(put)
    gain, error = transfer.gain, float(np.sqrt(transfer.covariance[0, 0]))
    put("gain", gain, error)
    read, read_error = transfer.read_noise()
    coarse = bool(frames.darks) and is_coarse(frames.darks)
    if coarse and frames.few:
        few = min(zip(frames.darks, frames.few, strict=True), key=lambda pair: pair[0].time)[1]
        coarse_sites = [one for one in _coarse(few, usable, frames.darks[0].tile) if one is not None]
        if coarse_sites:
            # A site whose black lies between two codes may show a scatter that is all pattern.
            usual = float(np.median([one.scatter for one in coarse_sites]))
            coarse_sites = [one for one in coarse_sites if abs(one.scatter - usual) < 0.3 * usual]
            weight = np.array([1.0 / one.scatter_error**2 for one in coarse_sites])
            scatter = float((weight * [one.scatter for one in coarse_sites]).sum() / weight.sum())
            coarse_read = scatter / gain
            coarse_error = float(np.hypot(1 / np.sqrt(weight.sum()), coarse_read * error) / gain)
            share = read_error**2 / (read_error**2 + coarse_error**2)
            read = share * coarse_read + (1 - share) * read
            read_error = float(1 / np.hypot(1 / read_error, 1 / coarse_error))
    common = [stack.rows for stack in frames.darks if stack.frames >= 2 and not coarse]
    if common:
        precise = min(common, key=lambda one: one[1])
        if precise[0] > 4 * precise[1] and read**2 > precise[0] / gain**2:
            row = float(np.sqrt(precise[0]) / gain)
            put("row_noise", row, precise[1] / (2 * np.sqrt(precise[0]) * gain), "darks")
            alone = float(np.sqrt(read**2 - row**2))
            read_error = float(np.hypot(read_error * read, precise[1] / (2 * gain**2)) / alone)
            read = alone
    put("read_noise", read, read_error)
    if ends:
        put("full_well", top / gain, top / gain * error / gain)
    if level.current is not None:
        current, current_error = level.current
        put("dark_current", current / gain, float(np.hypot(current_error / gain, current * error / gain**2)))
    shortest = min(frames.darks, key=lambda one: one.time, default=None)
    dsnu = None if shortest is None or coarse else pattern.dark_signal(shortest, usable)
    if dsnu is not None:
        put("dsnu", dsnu[0] / gain, dsnu[1] / gain)
