"""Views placed, rigs tied together, and the terms of the lenses chosen, step by step."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from calib.adjustment.bundle_adjustment import Free, adjust, lens_of, misses
from calib.adjustment.lens_ladder import climb
from calib.adjustment.point_refinement import refine_points
from calib.data.features import FEWEST_MATCHES
from calib.poses.first_model import NO_START, FirstModels, camera_numbers, first_models, matched
from calib.poses.focal import focal_priors, settle_focal
from calib.poses.places import align_to_places
from calib.poses.pose_inputs import PoseInputs
from calib.poses.rigs.known_rig import camera_of, to_metres
from calib.poses.rigs.non_overlapping import Joined, join, unjoined
from calib.poses.rigs.tied_model import TiedModel, polish, tied_model
from calib.poses.steps import Done, Steps
from calib.poses.turning.turned_views import TurnedViews, turned_views
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

MAX_ERROR = 4.0
"""Largest error of a correspondence, px, in pictures of 1280 px or wider; less in smaller ones, at least half
of it.
"""
ALIGNED = 0.4
"""Error of patch-refined points, as a fraction of the feature error."""


@dataclass(frozen=True, eq=False)
class AdjustedModel:
    """A model with the terms of its lenses chosen. free: how it was adjusted; typical: its miss, px;
    metric: its unit is the metre; held: cameras whose lenses stayed as the files say; left_out: views that
    others contradict; hanging: those that one pair holds on the others; by_motion: cameras that are tied by
    it alone."""

    reconstruction: Any
    free: Free
    typical: float
    metric: bool
    held: frozenset[str]
    left_out: frozenset[ViewId]
    hanging: frozenset[ViewId]
    by_motion: frozenset[str]
    rungs: tuple[Rung, ...]
    rig_rung: Rung
    lens_rungs: tuple[Rung, ...]

    @property
    def is_fisheye(self) -> bool:
        """True if the lenses are fisheyes of two terms."""
        return self.free.model == "RADIAL_FISHEYE"

    def centred(self, cameras: Mapping[str, Lens]) -> dict[str, Lens]:
        """Lenses with the principal points of the first guesses."""
        images = (self.reconstruction.image(index) for index in self.reconstruction.reg_image_ids())
        placed = {ViewId.of_image(image.name).camera: image.camera_id for image in images}
        return {
            name: lens_of(self.reconstruction.cameras[number]).model_copy(
                update={"cx": cameras[name].cx, "cy": cameras[name].cy}
            )
            for name, number in placed.items()
        }


def adjusted_model(inputs: PoseInputs, cameras: Mapping[str, Lens]) -> AdjustedModel | TurnedViews:
    """Place the views beginning with these lenses, tie rigs together, and choose the lenses' terms.

    Views from one place have their turns instead.
    """
    known = inputs.known
    # Errors of features are some pixels of a large picture, and no less than half of that in a small one.
    width = max(lens.width for lens in cameras.values())
    max_error = MAX_ERROR * min(max(width / 1280, 0.5), 1.0)
    database = pycolmap.Database.open(":memory:")
    models = {
        name: camera_of(known.lenses[name])
        if name in known.lenses
        else _camera(lens, name in inputs.focal_known)
        for name, lens in cameras.items()
    }
    pairs = matched(inputs, database, models, max_error)
    steps = Steps(inputs.unfinished, inputs.cache_key(cameras))
    # Views from one place have no depth: they end here, with turns instead of poses.
    if not inputs.turntable:
        turned = turned_views(
            inputs.features, pairs, {**cameras, **known.lenses}, known.lenses, inputs.focal_known, max_error
        )
        if turned is not None:
            return turned
    first = first_models(inputs, steps, database, models, pairs, cameras, max_error)
    # Motion determines the distance of cameras without a common view too badly to scale the scene.
    metric = sum(to_metres(first.main.reconstruction, known, rig) is not None for rig in inputs.rigs) > 0
    free = Free(
        "RADIAL_FISHEYE" if any(lens.fisheye for lens in cameras.values()) else "SIMPLE_RADIAL",
        fixed=camera_numbers(models, {*known.lenses, *first.held}),
        placed=camera_numbers(models, known.cam_from_rig),
        focal=focal_priors(
            {models[name].camera_id: prior for name, prior in inputs.focal.items() if name in models}
        ),
    )
    # Rigs are tied before lenses climb: what a rig explains needs no further term.
    joined, tied = _tied(inputs, steps, database, first, free, max_error, metric)
    reconstruction, typical = _refined(inputs, steps, tied, max_error)
    if reconstruction.num_points3D() < FEWEST_MATCHES:
        raise CalibrationError(NO_START.format(first.main.pairs))
    # A focal length that the scene does not determine is held at the files' before terms are chosen by it.
    names = {models[name].camera_id: name for name in models}
    free, rungs = settle_focal(reconstruction, tied.free, typical, inputs.threads, names, inputs.focal)
    # Stated places come last: a board or a ruler is more exact, and has made the unit the metre.
    if not metric:
        free, place_rungs = _at_stated_places(inputs, tied.uncut, reconstruction, free, typical)
        rungs = (*place_rungs, *rungs)
    typical = misses(reconstruction).typical
    why_fixed = "the files gave the lenses" if first.held else "a board gave the lenses"
    reconstruction, free, lens_rungs = _with_lens_terms(
        inputs, steps, reconstruction, tied.uncut, free, typical, why_fixed
    )
    every = [first.main, *(one for one in first.apart if one.cameras <= joined.cameras)]
    return AdjustedModel(
        reconstruction=reconstruction,
        free=free,
        typical=typical,
        metric=metric,
        held=first.held,
        left_out=frozenset().union(*(one.left_out for one in every)),
        hanging=frozenset().union(*(one.hanging for one in every)),
        by_motion=joined.cameras,
        rungs=(*(rung for one in every for rung in one.rungs), *joined.rungs, *first.unplaced),
        rig_rung=tied.rung,
        lens_rungs=(*rungs, *lens_rungs),
    )


def _tied(
    inputs: PoseInputs,
    steps: Steps,
    database: Any,
    first: FirstModels,
    free: Free,
    max_error: float,
    metric: bool,
) -> tuple[Joined, TiedModel]:
    """Tie rigs together, and cameras that are apart by motion as far as that makes a rigid rig."""

    def step() -> Done:
        joined = join(first.main.reconstruction, [one.reconstruction for one in first.apart], inputs.rigs)
        tied = tied_model(inputs, database, joined, free, max_error, metric)
        if joined.cameras and not tied.rung.taken:
            rung = unjoined(joined.cameras, tied.rung.reason)
            joined = Joined(first.main.reconstruction, frozenset(), (rung,))
            tied = tied_model(inputs, database, joined, free, max_error, metric)
        rest = {
            "cameras": sorted(joined.cameras),
            "rungs": [one.model_dump(mode="json") for one in (tied.rung, *joined.rungs)],
            "typical": tied.typical,
            "placed": sorted(tied.free.placed),
        }
        return Done((tied.reconstruction, tied.uncut), rest)

    done = steps.result(step)
    (reconstruction, uncut), rest = done.models, done.rest
    rung, *rungs = map(Rung.model_validate, rest["rungs"])
    placed = replace(free.within(reconstruction), placed=frozenset(rest["placed"]))
    return (
        Joined(reconstruction, frozenset(rest["cameras"]), tuple(rungs)),
        TiedModel(reconstruction, placed, rest["typical"], rung, uncut),
    )


def _refined(inputs: PoseInputs, steps: Steps, tied: TiedModel, max_error: float) -> tuple[Any, float]:
    """Place points by their patches, which err by less than features do, where noise allows; the model and
    its typical miss, px.
    """
    reconstruction = tied.reconstruction
    if not inputs.pictures or reconstruction.num_points3D() < FEWEST_MATCHES:
        return reconstruction, tied.typical

    def step() -> Done:
        refine_points(reconstruction, inputs.pictures, inputs.progress)
        typical = polish(reconstruction, tied.free, ALIGNED * max_error, inputs.threads, inputs.progress)
        return Done((reconstruction,), {"typical": typical})

    done = steps.result(step)
    return done.models[0], done.rest["typical"]


def _at_stated_places(
    inputs: PoseInputs, uncut: Any | None, reconstruction: Any, free: Free, typical: float
) -> tuple[Free, tuple[Rung, ...]]:
    """Align both models to the places that files state, and adjust the one that was cut by them."""
    places, rung = align_to_places(reconstruction, inputs.stated)
    free = replace(free, places=places)
    if places:
        if uncut is not None:
            align_to_places(uncut, inputs.stated)
        adjust(reconstruction, free, typical, inputs.threads)
    return free, () if rung is None else (rung,)


def _with_lens_terms(
    inputs: PoseInputs,
    steps: Steps,
    reconstruction: Any,
    uncut: Any | None,
    free: Free,
    typical: float,
    why_fixed: str,
) -> tuple[Any, Free, tuple[Rung, ...]]:
    """Choose the terms of the lenses and adjust the model with them."""

    def step() -> Done:
        taken, rungs = climb(reconstruction, free, typical, inputs.threads, inputs.progress, why_fixed, uncut)
        adjust(reconstruction, taken, typical, inputs.threads)
        terms = {name: getattr(taken, name) for name in ("model", "radial", "principal_point")}
        return Done(
            (reconstruction,), {"terms": terms, "rungs": [one.model_dump(mode="json") for one in rungs]}
        )

    done = steps.result(step)
    rungs = tuple(map(Rung.model_validate, done.rest["rungs"]))
    return done.models[0], replace(free, **done.rest["terms"]), rungs


def _camera(lens: Lens, focal_known: bool) -> Any:
    if lens.fisheye:
        return camera_of(lens)
    camera = pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", lens.fx, lens.width, lens.height)
    camera.has_prior_focal_length = focal_known
    return camera
