"""Light of a placed scene: what points that several views share tell of lenses, cameras and photographs."""

from collections.abc import Mapping
from dataclasses import dataclass

from calib.colour.colour_record import balance
from calib.colour.white_balance import Balance
from calib.evidence import Evidence
from calib.light import each_photograph, tracks, vignetting
from calib.light.constant_settings import stated_by
from calib.light.each_photograph import Development
from calib.light.photograph_observations import photograph_observations
from calib.light.vignetting import Falloff
from calib.place_views import Placement
from calib.request import ASKED
from imaging.arrays import Array
from imaging.progress import Progress
from imaging.session.records import Rung
from imaging.session.view_id import ViewId


@dataclass(frozen=True, eq=False)
class SceneLight:
    """Light of a placed scene, as scene points tell it.

    Attributes:
        falloff: Falloff of the lenses and sensitivity of the cameras.
        white: White balance between the cameras.
        development: Exposure and white balance of each photograph; None without photographs.
        brightness: Natural log of the luminance around the features of each view, [K].
    """

    falloff: Falloff
    white: Balance
    development: Development | None
    brightness: Mapping[ViewId, Array]


def measure_scene_light(evidence: Evidence, placement: Placement, progress: Progress) -> SceneLight:
    """Measure falloff, sensitivities, white balance, and the settings of each photograph.

    Args:
        evidence: Session, its views and sensors.
        placement: Poses of the views, and the brightness around their features.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        What was measured; parts that are to be left out are neutral, with a rung that says so.
    """
    progress("measuring falloff", 0, 1)
    model, cameras, without = placement.model, evidence.session.record.cameras, evidence.without
    names = sorted(model.lenses)
    brightness = {view: summary.brightness for view, summary in placement.summaries.items()}
    colours = {view: summary.colour for view, summary in placement.summaries.items()}

    # Photographs whose settings differ are made comparable before the falloff is measured.
    photographs = {camera.name for camera in cameras if camera.kind == "ldr"}
    stated, development = stated_by(evidence.session, evidence.views), None
    if photographs:
        observations = photograph_observations(model, colours, photographs, None)
        development = each_photograph.estimate(*observations, stated, without)
        brightness = development.brightness(brightness)

    # Light through different filters is compared only with its like.
    through = {view.camera.name: frozenset(shot.band for shot in view.shots) for view in evidence.views}
    filters = list(dict.fromkeys(through[name] for name in names))
    falloff = vignetting.estimate(
        tracks.tracks_of(model, brightness, names).apart([filters.index(through[name]) for name in names]),
        names,
        {camera.name: f"{camera.make} {camera.model}" for camera in cameras},
        comparable=len(filters) == 1,
        uncorrected={
            camera.name: vignetting.natural(model.lenses[camera.name])
            for camera in cameras
            if camera.kind == "raw" and camera.name in model.lenses
        },
        without=without,
    )

    # The first estimate took the falloff for part of what photographs differ by.
    if development is not None and development.differs:
        observations = photograph_observations(model, colours, photographs, falloff)
        development = each_photograph.estimate(*observations, stated, without)

    white = Balance({}, {}, (Rung(name="white_balance", taken=False, reason=ASKED),))
    if "white_balance" not in without:
        white = balance(model, colours, evidence.sensors, falloff, list(evidence.charts.evidence))
    return SceneLight(falloff, white, development, brightness)
