"""`--bracket auto`: a rig is metered, its bracket planned, and both are put into words and numbers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from capture.bracket.code_noise import ASSUMED, CodeNoise
from capture.bracket.exposure_choices import common_isos, common_times, exposure_list, without_idle_isos
from capture.bracket.goals import BracketGoals
from capture.bracket.metering.meter import Metering, meter
from capture.bracket.planner import BracketPlan, Target, plan_bracket
from drivers.camera import Camera
from imaging.optics.exposure import Exposure
from imaging.progress import Progress, unreported


@dataclass(frozen=True)
class Automatic:
    """A planned bracket, what it was planned for, and why it is as it is."""

    plan: BracketPlan
    metering: Metering
    reason: str


def plan_automatically(
    cameras: Mapping[str, Camera],
    like: Exposure,
    wanted: BracketGoals,
    *,
    frames: Sequence[int] = (0,),
    move_to: Callable[[int], None] = lambda frame: None,
    progress: Progress = unreported,
) -> Automatic:
    """Meter at the first, the middle and the last of `frames`, and plan one bracket for all cameras.

    Args:
        cameras: Cameras by name.
        like: Exposure with the f-number to keep, since another would show another depth of field.
        wanted: Goals and limits of the bracket.
        frames: Frames of the plan, at least one.
        move_to: Callback that brings rig or scene to a frame, before it is metered.
        progress: Callback for each probe of the meter.

    Returns:
        The bracket, the metering, and the reason in words.

    Raises:
        CaptureError: The cameras have no shutter time in common, the meter finds no light that can be
            measured, or no bracket fits into the total time.
        InputError: A limit leaves no exposure.
        CameraError: A camera does not report what it can be set to.
    """
    metering, exposures = _metered(cameras, like, wanted, frames, move_to, progress)
    if any(isinstance(target.noise, CodeNoise) for target in metering.targets):
        useful = tuple(
            exposure for exposure in exposures if exposure.iso == exposures[0].iso
        )  # how noisy others are is unknown
    else:
        useful = without_idle_isos(metering.targets, exposures, wanted.snr)
    plan = plan_bracket(metering.targets, useful, wanted)
    return Automatic(plan, metering, _reason(plan, metering, wanted))


def meter_rig(
    cameras: Mapping[str, Camera],
    like: Exposure,
    *,
    frames: Sequence[int] = (0,),
    move_to: Callable[[int], None] = lambda frame: None,
    progress: Progress = unreported,
) -> Metering:
    """Return what a bracket that was chosen otherwise is up against.

    Args:
        cameras: Cameras by name.
        like: Exposure with the f-number to keep.
        frames: Frames of the plan, at least one; the first, the middle and the last are metered.
        move_to: Callback that brings rig or scene to a frame, before it is metered.
        progress: Callback for each probe of the meter.

    Returns:
        The range of radiance of each colour channel of each camera, and the probes.

    Raises:
        CaptureError: The cameras have no shutter time in common, or the meter finds no light that can be
            measured.
        CameraError: A camera does not report what it can be set to.
    """
    return _metered(cameras, like, BracketGoals(), frames, move_to, progress)[0]


def _metered(
    cameras: Mapping[str, Camera],
    like: Exposure,
    wanted: BracketGoals,
    frames: Sequence[int],
    move_to: Callable[[int], None],
    progress: Progress,
) -> tuple[Metering, tuple[Exposure, ...]]:
    """Probes at the lowest ISO, where a sensor has its largest range; and the list to plan from."""
    able = [camera.capabilities() for camera in cameras.values()]
    exposures = exposure_list(common_times(able), common_isos(able), like.f_number, wanted)
    lowest = [exposure for exposure in exposures if exposure.iso == exposures[0].iso]
    positions = sorted({frames[0], frames[len(frames) // 2], frames[-1]})
    return meter(cameras, lowest, positions=positions, move_to=move_to, progress=progress), exposures


def _reason(plan: BracketPlan, metering: Metering, wanted: BracketGoals) -> str:
    """One paragraph for plans.jsonl."""
    limits = [
        f"{name} {value:g}{unit}"
        for name, value, unit in (
            ("slowest", wanted.slowest, " s"),
            ("in all", wanted.total, " s"),
            ("highest ISO", wanted.highest_iso, ""),
        )
        if value is not None
    ]
    widest = max(metering.targets, key=lambda target: target.stops)
    developing = dict.fromkeys(
        target.camera for target in metering.targets if isinstance(target.noise, CodeNoise)
    )
    parts = [
        f"metered with {len(metering.probes)} probes: up to {widest.stops:.1f} stops ({widest}); "
        f"the fewest exposures for {wanted.snr:g} dB" + (f" within {', '.join(limits)}" if limits else ""),
        *([f"of {', '.join(developing)} {ASSUMED}, at the lowest ISO"] if developing else []),
        *(str(shortfall) for shortfall in plan.shortfalls),
        *(f"{name} was not metered: {why.rstrip('.')}" for name, why in metering.failed.items()),
    ]
    return "; ".join(parts)


@dataclass(frozen=True)
class Worth:
    """Value of an exposure to a camera, at the worst of its channels.

    snr: dB at the dark end of what the camera sees; headroom: stops from the bright end to where the
    exposure clips, negative if it does. snr_known, headroom_known: False where the meter did not find that
    end, so that the value is the most that it may be.
    """

    snr: float
    headroom: float
    snr_known: bool
    headroom_known: bool


def worths(targets: Sequence[Target], exposure: Exposure) -> dict[str, Worth]:
    """The worth of an exposure by camera; under "rig" that of the worst camera for each end."""
    names = dict.fromkeys(target.camera for target in targets)
    groups = {name: [target for target in targets if target.camera == name] for name in names}
    return {
        name: Worth(
            min(target.noise.snr(target.dark, exposure) for target in group),
            min(target.headroom(exposure) for target in group),
            all(target.no_darker for target in group),
            all(target.no_brighter for target in group),
        )
        for name, group in (groups | {"rig": list(targets)}).items()
    }
