"""Start of an environment, and its suggestion by geometry: a world of light by direction."""

from dataclasses import replace

import numpy as np
import pytest

from imaging.errors import InputError
from imaging.files.exr.reading import read_exr
from imaging.session.records import Rung
from recon import reconstruct as stage
from recon.data.dataset import Dataset, View
from recon.data.geometry import rays
from recon.data.light import Light
from recon.decide.evidence import Evidence, Run
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.decide.request import TrainingRequest
from recon.decide.steps.far_field import FEWEST_JUDGED, SUGGESTED, SURE, environment_for, far_share
from recon.decide.trials import HELD_OUT
from recon.result.model import ENVIRONMENT
from recon.result.scene import open_scene
from recon.start.far_light import far_light, without_far
from recon.start.initialisation import Start
from tests.recon.decide.runs import run_of, settings


def light(directions: np.ndarray) -> np.ndarray:
    """Light of a sky [..., 3]."""
    x, y, z = np.moveaxis(directions / np.linalg.norm(directions, axis=-1, keepdims=True), -1, 0)
    return 2.0 ** (3 * np.stack([np.sin(5 * x), np.cos(4 * y), np.sin(6 * z)], -1))


def ahead(view: View) -> np.ndarray:
    """World directions [H, W, 3] of a view's pixels."""
    y, x = np.mgrid[: view.lens.height, : view.lens.width]
    turn = view.lens.cam_from_world[:3, :3]
    return rays(view.lens, np.stack([x, y], -1) + 0.5) @ turn


def pictures(dataset: Dataset, *, wall: float | None) -> list[tuple[np.ndarray, np.ndarray]]:
    """Training views of the sky, or of a wall painted like it that many units away."""
    made = []
    for view in dataset.train:
        towards = ahead(view)
        if wall is not None:
            middle = dataset.train[0].lens.cam_from_world[2, :3]
            along = (wall - view.centre @ middle) / (towards @ middle)
            towards = view.centre + along[..., None] * towards
        made.append((light(towards).astype(np.float32), np.ones(towards.shape[:2], bool)))
    return made


def test_the_light_of_every_direction_that_is_seen_is_found(toy_dataset: Dataset) -> None:
    images = pictures(toy_dataset, wall=None)
    far = far_light(toy_dataset.train, images, lambda radiance: radiance / 4)
    for view, (rgb, _) in zip(toy_dataset.train, images, strict=True):
        off = np.abs(np.log(4 * far.render(view.lens).numpy() / rgb))
        assert np.median(off) < 0.02
        assert np.percentile(off, 95) < 0.1  # corners that no other view sees have the light next to them
    assert np.isfinite(far.ln_light.numpy()).all()


def test_a_near_thing_in_one_view_does_not_hide_what_others_see(toy_dataset: Dataset) -> None:
    images = pictures(toy_dataset, wall=None)
    rgb, trusted = images[0]
    spoiled = rgb.copy()
    spoiled[10:30, 10:30] = 1000.0
    far = far_light(toy_dataset.train, [(spoiled, trusted), *images[1:]], lambda radiance: radiance)
    assert float(far.ln_light.max()) < np.log(9)


def test_saturated_pixels_are_lower_bounds_of_the_light_of_a_direction(toy_dataset: Dataset) -> None:
    """One exposure a view: most views saturate where the sky is brightest, each at another light."""
    images = []
    for number, (rgb, _) in enumerate(pictures(toy_dataset, wall=None)):
        most = 2.0 ** (number % 4)
        images.append((np.minimum(rgb, most), (rgb < most).all(-1)))
    assert np.mean([trusted.mean() for _, trusted in images]) < 0.8
    far = far_light(toy_dataset.train, images, lambda radiance: radiance)
    off = []
    for view, (rgb, _) in zip(toy_dataset.train, pictures(toy_dataset, wall=None), strict=True):
        below = (rgb < 8).all(-1)
        off.append(np.abs(np.log(far.render(view.lens).numpy()[below] / rgb[below])))
    assert np.percentile(np.concatenate(off), 90) < 0.1
    points = start_of(toy_dataset, images)
    assert far_share(toy_dataset, images, points, lambda light: light) > 2 * SURE


@pytest.mark.parametrize("wall", [None, 1.0])
def test_no_gaussian_starts_in_the_air_where_views_look_through_to_the_sky(
    toy_dataset: Dataset, wall: float | None
) -> None:
    """Points of one depth, with the light of the view that each comes from; on the wall they are true."""
    images = pictures(toy_dataset, wall=wall)
    far = far_light(toy_dataset.train, images, lambda radiance: radiance / 4)
    middle = toy_dataset.train[0].lens.cam_from_world[2, :3]
    points, colours = [], []
    for view, (rgb, _) in zip(toy_dataset.train, images, strict=True):
        towards = ahead(view)[::4, ::4]
        along = (1.0 - view.centre @ middle) / (towards @ middle)
        points.append((view.centre + along[..., None] * towards).reshape(-1, 3))
        colours.append(rgb[::4, ::4].reshape(-1, 3))
    start = Start(np.concatenate(points), np.concatenate(colours).astype(np.float64), sparse=20)
    near = without_far(start, toy_dataset.train, images, far, lambda radiance: radiance / 4)
    assert near.sparse == 20
    assert np.array_equal(near.xyz[:20], start.xyz[:20])
    share = (len(near.xyz) - 20) / (len(start.xyz) - 20)
    assert share < 0.05 if wall is None else share > 0.9, share


def start_of(dataset: Dataset, images: list[tuple[np.ndarray, np.ndarray]]) -> Start:
    """What a training would start from; the calibration's points are of another world than these pictures."""
    model = dataset.points().xyz
    return Start(model, np.ones((len(model), 3)), len(model))


def looked(dataset: Dataset, images: list[tuple[np.ndarray, np.ndarray]]) -> tuple[Run, Evidence]:
    """A run, and as its evidence the views with these radiance images."""
    return run_of(dataset, settings()), Evidence(dataset, images, Light(1.0, 1.0), 0.0)


def test_a_far_field_is_suggested_by_far_light_and_not_by_a_wall(toy_dataset: Dataset) -> None:
    shares = []
    for wall in (None, 1.0):
        images = pictures(toy_dataset, wall=wall)
        shares.append(far_share(toy_dataset, images, start_of(toy_dataset, images), lambda light: light))
    assert shares[0] > 2 * SURE
    assert shares[1] < SUGGESTED


def test_what_views_see_through_the_points_decides_without_a_trial(toy_dataset: Dataset) -> None:
    for wall, taken in ((None, True), (1.0, False)):
        images = pictures(toy_dataset, wall=wall)
        rung = environment_for(
            *looked(toy_dataset, images), settings(), start_of(toy_dataset, images), lambda light: light,
            "no time",
        )  # fmt: skip
        assert rung.taken is taken
        assert "light from far away" in rung.reason


def test_display_values_take_no_far_field_without_a_trial(toy_dataset: Dataset) -> None:
    """Five of five sets of real photographs lose by one (bench/real/far_field.py)."""
    photographs, sky = replace(toy_dataset, kind="ldr"), pictures(toy_dataset, wall=None)
    taken = [
        environment_for(
            *looked(photographs, sky), settings(method=method), start_of(photographs, sky),
            lambda light: light, "no time",
        ).taken
        for method in ("vanilla", "hdr-gs")
    ]  # fmt: skip
    assert taken == [False, True]


def test_a_trial_has_the_last_word_where_it_can_be_made(
    toy_long: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A castle of eleven views looks through a fifth of its points, and loses 2.5 dB in the trial."""
    sky = pictures(toy_long, wall=None)
    few = replace(toy_long, train=toy_long.train[: FEWEST_JUDGED * HELD_OUT - 1])
    for gain, taken in ((-2.5, False), (2.5, True)):
        judged = Rung.judged("environment", gain, 0.5, "dB", "a trial")
        monkeypatch.setattr("recon.decide.steps.far_field.tried", lambda *_, judged=judged: judged)
        for dataset, expected in ((toy_long, taken), (few, True)):
            images = sky[: len(dataset.train)]
            start = start_of(dataset, images)
            run, evidence = looked(dataset, images)
            for against in (None, "no time") if dataset is few else (None,):
                rung = environment_for(run, evidence, settings(), start, lambda light: light, against)
                assert rung.taken is expected
                assert ("too few" in rung.reason) is (dataset is few)


def test_a_scene_with_an_environment_is_drawn_stored_and_written(session_copy, monkeypatch) -> None:
    """A camera that looks away from all Gaussians sees what environment.exr has in its directions."""
    monkeypatch.setitem(QUALITIES, "draft", Quality(iterations=6, gaussians=200, width=64))
    overrides = Overrides(environment=True)
    folder = stage.reconstruct(
        session_copy, TrainingRequest(quality="draft", overrides=overrides, name="far")
    )
    scene = open_scene(folder)
    (rung,) = (one for one in scene.record.rungs if one.name == "environment")
    assert rung.taken
    assert rung.reason == "asked for"
    picture = read_exr(folder / ENVIRONMENT)
    axes = np.array(
        [[float(part) for part in picture.attributes[f"rig:{name}"].split()]
         for name in ("longitude90", "up", "middle")]
    )  # fmt: skip
    camera = scene.views[0].splat_camera
    motion = np.diag([-1.0, 1.0, -1.0, 1.0]) @ camera.cam_from_world
    camera = replace(camera, cam_from_world=motion, width=16, height=12, cx=8.0, cy=6.0)
    y, x = np.mgrid[:12, :16]
    towards = rays(camera, np.stack([x, y], -1) + 0.5) @ motion[:3, :3]
    right, up, middle = np.moveaxis(towards @ axes.T, -1, 0)
    rgb = picture.rgb()
    rows = len(rgb)
    row = rows * (0.5 - np.arctan2(up, np.hypot(right, middle)) / np.pi)
    column = rows * (1 - np.arctan2(right, middle) / np.pi)
    nearest = rgb[row.astype(int).clip(0, rows - 1), column.astype(int) % (2 * rows)]
    assert np.median(np.abs(np.log(scene.render(camera) / nearest))) < 0.1
    text = (folder / "splats.ply").read_bytes()[:2000].decode("latin1")
    assert "light from far away: the last" in text


def test_an_environment_cannot_be_maybe() -> None:
    with pytest.raises(InputError, match="--set environment=maybe"):
        Overrides.of(["environment=maybe"])
    assert Overrides.of(["environment=0"]).environment is False
    assert Overrides.of(Overrides(environment=True).words()).environment is True


def test_behind_photographs_with_alpha_is_nothing(toy_dataset):
    """Ignore what the same light in the same directions suggests."""
    covered = tuple(
        replace(
            view,
            shots=tuple(shot.showing(alpha=np.ones(view.valid.shape, np.float32)) for shot in view.shots),
        )
        for view in toy_dataset.train
    )
    asked = settings().model_copy(update={"quality": "draft"})
    sky = pictures(toy_dataset, wall=None)
    rungs = {
        with_alpha: environment_for(
            *looked(replace(toy_dataset, train=covered if with_alpha else toy_dataset.train), sky),
            asked, start_of(toy_dataset, sky), lambda light: light, "no trials here",
        )
        for with_alpha in (True, False)
    }  # fmt: skip
    assert [rungs[with_alpha].taken for with_alpha in (True, False)] == [False, True]
    assert "transparent" in rungs[True].reason
