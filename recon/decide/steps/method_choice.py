"""Choice of the method for a session, before training, in seconds."""

import numpy as np

from imaging.errors import ReconstructionError
from imaging.session.records import Rung
from recon.data.dataset import Dataset
from recon.decide.presets import MethodName
from recon.methods import hdr_gs, nh_3dgs, vanilla
from recon.observe.calibrated_curves import STOP_APART, Curves, developed, sensitivity_span
from recon.observe.tone_grid import EXACT

BEYOND_ONE = 1.5
"""Stops between separately exposed photographs above which they hold more light than display values. A castle
whose photographs lie 1.1 stops apart is better with gains on display values
(bench/results/each_photograph.md).
"""


def method_for(dataset: Dataset, asked: MethodName) -> tuple[str, tuple[Rung, ...]]:
    """The method as asked for, or chosen, and the reasons; ReconstructionError where it does not fit."""
    if asked == "auto":
        return chosen_method(dataset)
    if asked == hdr_gs.NAME and dataset.kind != "ldr":
        raise ReconstructionError(
            f"{dataset.session} holds linear images, which have no tone curve to learn: use --method nh-3dgs."
        )
    if asked == nh_3dgs.NAME and dataset.kind == "ldr":
        raise ReconstructionError(
            f"{dataset.session} holds developed photographs, no linear light: use --method hdr-gs or vanilla."
        )
    return asked, (Rung(name="method", taken=True, reason="asked for"),)


def chosen_method(dataset: Dataset) -> tuple[str, tuple[Rung, ...]]:
    """The method for `auto`, and the reasons.

    Linear input is modelled as it is. Photographs get a tone curve when their exposures differ, since only
    then the curve can be separated from the light; otherwise display values are all there is. Settings that a
    camera chose anew for each photograph become gains on these, unless they span more light with the
    sensitivities of the cameras.
    """
    if dataset.kind != "ldr":
        if any(view.sensor.kind == "ldr" for view in dataset.views):
            reason = "only some cameras give linear light: the photographs of the others are tied to it"
            return nh_3dgs.NAME, (Rung(name="tone curve", taken=True, reason=reason),)
        kind = {"raw": "RAW mosaics", "hdr": "linear EXR", "mixed": "RAW mosaics and EXR"}[dataset.kind]
        reason = f"{kind} are linear: no tone curve is needed"
        return nh_3dgs.NAME, (Rung(name="linear light", taken=True, reason=reason),)
    stops = np.log2([shot.k for view in dataset.train for shot in view.shots])
    apart = float(stops.max() - stops.min())
    several = any(len(view.shots) > 1 for view in dataset.train)
    measured = all(view.sensor.response.residual is not None for view in dataset.train)
    span = sensitivity_span(dataset)
    if developed(dataset) or (not several and not measured and span >= BEYOND_ONE):
        chose = "the camera chose exposure or white balance anew for each photograph"
        if len({view.camera for view in dataset.train}) > 1:
            chose = "photographs differ in exposure, sensitivity or white balance"
        reason = f"{chose}, up to {span:.1f} stops apart"
        curved = span >= BEYOND_ONE
        return (hdr_gs if curved else vanilla).NAME, (Rung(name="tone curve", taken=curved, reason=reason),)
    if (several or measured) and apart >= STOP_APART:
        reason = f"exposures of {'a view' if several else 'the views'} lie up to {apart:.1f} stops apart"
        if not several:
            reason += ", and calibration measured the response on points that views share"
        return hdr_gs.NAME, (Rung(name="tone curve", taken=True, reason=reason),)
    reason = (
        f"exposures span {apart:.1f} stops, no view has a bracket and the response was not measured: curve "
        "and light cannot be separated"
        if not several
        else f"exposures span only {apart:.1f} stops: curve and light cannot be separated"
    )
    return vanilla.NAME, (Rung(name="tone curve", taken=False, reason=reason),)


def rungs(dataset: Dataset, method: str) -> tuple[Rung, ...]:
    """Rungs on the rest of the image formation; all from the calibration, without a trial.

    Whether training corrects the calibration is decided by `recon.decide.steps.corrections`, the number of
    Gaussians and whether their colours depend on the direction by `recon.decide.steps.size`.
    """
    clipped = float(np.mean([shot.saturated.mean() for view in dataset.train for shot in view.shots]))
    shares = [shot.saturated.mean() for view in dataset.train for shot in view.shots[:1]]
    cameras = [camera for camera in dataset.calibration.cameras if camera.lens is not None]
    distorted = [c.name for c in cameras if c.lens and (c.lens.fisheye or any(c.lens.terms[4:]))]
    shaded = [c.name for c in cameras if any(c.vignetting)]
    gains = [c.gain for c in cameras]
    span = float(np.log2(max(gains) / min(gains))) if gains else 0.0
    linear = method != vanilla.NAME or dataset.kind != "ldr"
    photographed = linear and any(view.sensor.kind == "ldr" for view in dataset.views)
    return (
        *((_grid(Curves.of(dataset)),) if photographed else ()),
        *_colours(dataset),
        Rung(
            name="one-sided saturation",
            taken=clipped > 0,
            reason=f"{100 * clipped:.2f} % of all samples are clipped, "
            f"{100 * float(np.mean(shares)):.2f} % of the shortest exposures",
        ),
        Rung(
            name="distortion",
            taken=bool(distorted),
            reason=f"{len(distorted)} of {len(cameras)} lenses are distorted",
        ),
        Rung(
            name="vignetting",
            taken=linear and bool(shaded),
            reason=f"{len(shaded)} of {len(cameras)} cameras have a calibrated falloff",
        ),
        Rung(
            name="camera gains",
            taken=linear and span > 0,
            reason=f"cameras differ by up to {span:.3f} stops",
        ),
    )


def uncoloured(dataset: Dataset) -> list[str]:
    """Cameras that gave RAW in colour and whose colours are not known: their light stays in camera RGB."""
    named = {camera.name for camera in dataset.calibration.cameras if camera.camera_from_rec709 is not None}
    return [name for name in _in_colour(dataset) if name not in named]


def _in_colour(dataset: Dataset) -> list[str]:
    """Cameras that gave RAW of more than one channel, as those without a colour filter do not."""
    raw = (view for view in dataset.views if view.sensor.kind == "raw")
    return list(dict.fromkeys(view.camera for view in raw if len(view.sensor.camera_from_rec709) > 1))


def _colours(dataset: Dataset) -> tuple[Rung, ...]:
    """Return whether RAW light becomes Rec.709."""
    raw = _in_colour(dataset)
    if not raw:
        return ()
    missing = uncoloured(dataset)
    reason = f"{len(raw) - len(missing)} of {len(raw)} RAW cameras have a matrix to linear Rec.709"
    if missing:
        reason += f"; light of {', '.join(missing)} stays camera RGB"
    return (Rung(name="camera colour", taken=len(missing) < len(raw), reason=reason),)


def _grid(curves: Curves) -> Rung:
    """Return how many nodes the tone curve has."""
    used, count = len(curves.nodes), 3 * len(curves.responses)
    reason = f"all {used:,} nodes, since the curve was not measured and may bend anywhere"
    if curves.measured:
        code = f"{255 * EXACT:g} of a code value"
        reason = f"{used:,} of {curves.finest:,} nodes hold the calibrated curve to {code}"
    return Rung(name="tone grid", taken=used == curves.finest, reason=reason, parameters=used * count)
