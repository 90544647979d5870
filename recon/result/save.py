"""Writing of a training's results: the scene, and its record."""

from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from scipy.spatial.transform import Rotation

from imaging.files import store
from imaging.merge.linear_frame import SensorSignalNoise
from imaging.optics.pose import Pose
from imaging.progress import Progress
from imaging.session.records import Rung
from imaging.session.session import Session
from recon.data.dataset import Dataset, View
from recon.data.shot import measured_light
from recon.decide.cost.prediction import ENOUGH, enough
from recon.decide.plan import TrainingPlan
from recon.decide.presets import QUALITIES
from recon.decide.settings import Settings
from recon.observe.photographs import Display, ToneCurve
from recon.observe.refinement import Refinement
from recon.result.display import exposure_of
from recon.result.environment_files import write_environment
from recon.result.model import (
    CALIBRATION,
    MODEL,
    REFINEMENT,
    DisplayValues,
    ModelRecord,
    SceneShot,
    SceneView,
    Use,
)
from recon.result.splats.splat_files import offset_of, write_splats
from recon.train.devices.training_device import device_name
from recon.train.training import Training


def write_scene(
    folder: Path,
    dataset: Dataset,
    training: Training,
    plan: TrainingPlan,
    loss: float | None,
    progress: Progress,
) -> None:
    """Write a scene, model.json last: all is there then.

    Before it come the PLY files, the environment if there is one, refinement.json of what was corrected, and
    calibration.json as it was.

    Args:
        folder: Of the scene.
        dataset: Views that it was trained on and is judged by, as calibrated.
        training: Training whose present state is written.
        plan: As it was decided.
        loss: Last that was logged; None before the first.
        progress: Callback for the current step, the steps done, and all of them.
    """
    gauge = _gauge(dataset)
    corrected = as_corrected(dataset, training.refinement)
    exposure = exposure_of(training, corrected)
    luminance = _luminance(dataset, training)
    write_environment(folder, training, gauge, luminance)
    display_db = write_splats(folder, corrected, training, exposure, gauge, luminance, progress)
    if training.refinement is not None and training.refinement.parameters:
        store.write_json(folder / REFINEMENT, training.refinement.facts())
    store.write_json(folder / CALIBRATION, dataset.calibration.model_dump(mode="json"))
    degree = training.method.degree(1.0)
    record = record_of(dataset, training, plan, loss, exposure, degree, display_db)
    store.write_json(folder / MODEL, record.model_dump(mode="json"))


def record_of(
    dataset: Dataset,
    training: Training,
    plan: TrainingPlan,
    loss: float | None,
    exposure: float,
    degree: int,
    display_db: float | None,
) -> ModelRecord:
    """Return what is to be said of a training as it is now.

    Args:
        dataset: Views that it trains on and is judged by, as calibrated.
        training: Training, which has begun.
        plan: As it was decided.
        loss: Last that was logged; None before the first.
        exposure: Factor on radiance that shows the scene as middle grey.
        degree: Of the harmonics that the scene is drawn with.
        display_db: PSNR of splats.ply, as of `write_splats`; None where it is not known.

    Returns:
        The content of model.json.
    """
    light, refinement, schedule = training.light, training.refinement, training.schedule
    assert schedule is not None
    why = () if refinement is None else refinement.described_rungs()
    interrupted = training.iteration < schedule.total
    observation = training.method.observation
    return ModelRecord(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "torch", "numpy", "numba")},
        settings=plan.settings,
        session=Session.open(dataset.session).record.name,
        photographs_sha256=dataset.photographs_sha256,
        calibration_sha256=dataset.calibration_sha256,
        normaliser=light.normaliser,
        reference=light.reference,
        display=DisplayValues(response=observation.response, k=observation.k, developed=observation.developed)
        if isinstance(observation, Display)
        else None,
        radiance=f"relative to {_gauge(dataset)}",
        luminance=_luminance(dataset, training),
        bands=dataset.bands,
        transparent=any(view.transparent for view in dataset.views),
        world=dataset.world,
        offset=offset_of(dataset),
        exposure=exposure,
        display_db=display_db,
        degree=degree,
        views=scene_views(as_corrected(dataset, refinement)),
        gaussians=len(training.gaussians),
        train_seconds=round(training.seconds, 3),
        measuring_seconds=round(training.measuring, 3),
        device=device_name(training.gaussians.device),
        loss=loss,
        iterations=training.iteration,
        schedule=schedule.turns,
        ending="interrupted" if interrupted else training.ending or "schedule",
        held_out_db=training.curve[-1].db if training.curve else None,
        predicted=plan.prediction,
        rungs=(*plan.rungs, *why, *_early_stop(training, plan.settings, len(dataset.train))),
    )


def _gauge(dataset: Dataset) -> str:
    ldr = dataset.kind == "ldr"
    return "the calibration's response" if ldr else "camera signal = radiance x exposure scale"


def _luminance(dataset: Dataset, training: Training) -> tuple[float, float] | None:
    """Return what the light of the scene is in cd/m2, if its unit is that of a calibration that knows."""
    if dataset.bands:  # it is of Rec.709 alone
        return None
    scale, observation = dataset.calibration.luminance, training.method.observation
    drifts = isinstance(observation, Display) or (isinstance(observation, ToneCurve) and observation.learned)
    if scale is None or drifts or not {view.camera for view in dataset.views} <= set(scale.cameras):
        return None
    return scale.value, scale.error


def as_corrected(dataset: Dataset, refinement: Refinement | None) -> Dataset:
    """The data set with what training corrected of its views."""
    if refinement is None:
        return dataset
    parameters = {name: value.detach().cpu() for name, value in refinement.parameters.items()}
    return replace(refinement, parameters=parameters).corrected()


def scene_views(dataset: Dataset) -> tuple[SceneView, ...]:
    """The views of a scene and what each served for."""
    uses: tuple[tuple[Use, tuple[View, ...]], ...] = (
        ("training", dataset.train),
        ("validation", dataset.validation),
        ("test", dataset.test),
    )
    views = (_scene_view(view, dataset, use) for use, views in uses for view in views)
    return tuple(sorted(views, key=lambda view: view.id))


def _scene_view(view: View, dataset: Dataset, use: Use) -> SceneView:
    lens, camera = dataset.calibration.camera(view.camera).lens, dataset.world.camera_in_world(view.lens)
    assert lens is not None
    turn = Rotation.from_matrix(camera.cam_from_world[:3, :3])
    w, x, y, z = turn.as_quat(canonical=True, scalar_first=True).tolist()
    a, b, c = camera.cam_from_world[:3, 3].tolist()
    sizes = {"width": camera.width, "height": camera.height}
    return SceneView(
        camera=view.camera,
        frame=view.frame,
        use=use,
        lens=lens.model_copy(update=sizes | dict(zip(lens.names, camera.lens, strict=True))),
        cam_from_world=Pose(quaternion=(w, x, y, z), translation=(a, b, c)),
        shots=tuple(
            SceneShot(
                file=shot.file,
                k=shot.k,
                noise=(shot.noise.slope, shot.noise.floor)
                if isinstance(shot.noise, SensorSignalNoise)
                else None,
                measures=measured_light(shot, view.sensor.response),
            )
            for shot in view.shots
        ),
        cfa=() if view.sensor.cfa is None else view.sensor.cfa.rows,
        orientation=view.orientation,
    )


def _early_stop(training: Training, settings: Settings, views: int) -> tuple[Rung, ...]:
    """Return whether the training was made shorter, before it or on the way; empty without observation."""
    if not settings.early_stop:
        return ()
    cut, turns = training.ending == "early stop", training.schedule.turns if training.schedule else ()
    asked = settings.overrides.iterations or QUALITIES[settings.quality].iterations_of(views)
    worth = enough(asked)
    reason = f"at most {worth} of {asked} iterations, as scenes before gained less than {ENOUGH:g} dB by more"
    if cut:
        reason += (
            f"; the held-out quality hardly rose any more after {turns[-2][0]}, so the learning "
            f"rates came to their end in {turns[-1][0] - turns[-2][0]} more"
        )
    return (Rung(name="early stop", taken=cut or worth < asked, reason=reason),)
