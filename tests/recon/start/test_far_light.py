"""Start of an environment, and its suggestion by geometry: a world of light by direction."""

from dataclasses import replace

import numpy as np
import pytest

from imaging.errors import InputError
from imaging.files.exr import read_exr
from imaging.progress import unreported
from recon import reconstruct as stage
from recon.data.dataset import Dataset, View
from recon.data.geometry import rays
from recon.decide.far_field import BESIDE, SUGGESTED, environment_for, far_share
from recon.decide.overrides import Overrides
from recon.result.model import ENVIRONMENT
from recon.result.scene import open_scene
from recon.start.far_light import far_light
from recon.train.ranks import Ranks
from tests.recon.decide.test_corrections import settings


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
        off = np.abs(np.log(4 * far.seen(view.lens).numpy() / rgb))
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


def test_a_far_field_is_suggested_by_far_light_and_not_by_a_wall(toy_dataset: Dataset) -> None:
    sky = pictures(toy_dataset, wall=None)
    assert far_share(toy_dataset.train, sky) > 0.5
    assert far_share(toy_dataset.train, sky, BESIDE) < 0.5 * far_share(toy_dataset.train, sky)
    assert far_share(toy_dataset.train, pictures(toy_dataset, wall=1.0)) < SUGGESTED


def test_where_no_trial_is_made_the_agreement_of_views_decides(toy_dataset: Dataset) -> None:
    wanted = settings()
    grey = [(np.full_like(rgb, 0.2), seen) for rgb, seen in pictures(toy_dataset, wall=None)]
    for images, taken in ((pictures(toy_dataset, wall=None), True), (grey, False)):
        decided, rung = environment_for(toy_dataset, wanted, images, "no time", Ranks(), unreported)
        assert decided is rung.taken is taken
        assert "no time" in rung.reason


def test_a_scene_with_an_environment_is_drawn_stored_and_written(session_copy, monkeypatch) -> None:
    """A camera that looks away from all Gaussians sees what environment.exr has in its directions."""
    monkeypatch.setitem(stage.QUALITIES, "draft", stage.Quality(iterations=6, gaussians=200, width=64))
    overrides = Overrides(environment=True)
    folder = stage.reconstruct(session_copy, quality="draft", overrides=overrides, name="far")
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
            shots=tuple(shot.showing(alpha=np.ones(view.seen.shape, np.float32)) for shot in view.shots),
        )
        for view in toy_dataset.train
    )
    asked = settings().model_copy(update={"quality": "draft"})
    sky = pictures(toy_dataset, wall=None)
    taken = {
        told: environment_for(
            replace(toy_dataset, train=covered if told else toy_dataset.train),
            asked, sky, "no trials here", Ranks(), unreported,
        )
        for told in (True, False)
    }  # fmt: skip
    assert [taken[told][0] for told in (True, False)] == [False, True]
    assert "transparent" in taken[True][1].reason
